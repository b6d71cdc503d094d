#include "driver/standalone.h"

#include <string.h>

#define DEFAULT_TRAVEL 63.0f /* rad: ten turns */
#define SPEED_FILTER 0.4f    /* share of a new difference in the speed estimate */

/* A controller: default gains, and one sample of its law. Returns the command wished for. */
struct controller {
    int gains;
    float initial[MK_STANDALONE_GAINS];
    float (*step)(struct mk_standalone *s, const float *q, const float *v);
    bool wheel[MK_WIRE_JOINTS]; /* turns as far as it likes */
};

static float period(const struct mk_standalone *s)
{
    return (float)s->period_us * 1e-6f;
}

/* --- pi-speed: gains kp, ki, reference (rad/s) --------------------------------------------------
 */

#define PI_INTEGRAL_LIMIT 10.0f /* command units */

static float pi_speed(struct mk_standalone *s, const float *q, const float *v)
{
    (void)q;
    const float *k = s->gain;
    float error = k[2] - v[0];
    s->phase = MK_STANDALONE_TRACK;
    s->integral += k[1] * error * period(s);
    if (s->integral > PI_INTEGRAL_LIMIT)
        s->integral = PI_INTEGRAL_LIMIT;
    if (s->integral < -PI_INTEGRAL_LIMIT)
        s->integral = -PI_INTEGRAL_LIMIT;
    return k[0] * error + s->integral;
}

/* --- the table ------------------------------------------------------------------------------- */

static const struct controller controllers[MK_CONTROLLER_COUNT] = {
    [MK_CONTROLLER_PI_SPEED] = {3, {0.15f, 0.75f, 50.0f}, pi_speed, {true, true}},
};

static const struct controller *find(enum mk_controller c)
{
    bool known = (unsigned)c < MK_CONTROLLER_COUNT && controllers[c].step;
    return known ? &controllers[c] : NULL;
}

int mk_standalone_gain_count(enum mk_controller controller)
{
    const struct controller *c = find(controller);
    return c ? c->gains : 0;
}

bool mk_standalone_setup(struct mk_standalone *s, enum mk_controller controller, uint32_t period_us,
                         uint32_t record_every)
{
    const struct controller *c = find(controller);
    if (!c)
        return false;
    s->controller = controller;
    s->period_us = period_us;
    s->record_every = record_every;
    memcpy(s->gain, c->initial, sizeof s->gain);
    s->running = false;
    s->recorded = 0;
    s->phase = MK_STANDALONE_IDLE;
    return true;
}

void mk_standalone_start(struct mk_standalone *s, uint64_t now_ns)
{
    s->running = true;
    s->next_ns = now_ns;
    s->sample = 0;
    s->recorded = 0;
    s->phase = MK_STANDALONE_IDLE;
    s->integral = 0.0f;
    memset(s->speed, 0, sizeof s->speed);
}

float mk_standalone_step(struct mk_standalone *s, const float q[MK_WIRE_JOINTS])
{
    float dt = period(s);
    for (int j = 0; j < MK_WIRE_JOINTS; j++) {
        float difference = s->sample > 0 ? (q[j] - s->angle[j]) / dt : 0.0f;
        s->speed[j] += SPEED_FILTER * (difference - s->speed[j]);
        s->angle[j] = q[j];
    }
    return controllers[s->controller].step(s, s->angle, s->speed);
}

bool mk_standalone_out_of_travel(const struct mk_standalone *s)
{
    const struct controller *c = &controllers[s->controller];
    for (int j = 0; j < MK_WIRE_JOINTS; j++)
        if (!c->wheel[j] && !(s->angle[j] > -DEFAULT_TRAVEL && s->angle[j] < DEFAULT_TRAVEL))
            return true;
    return false;
}

void mk_standalone_record(struct mk_standalone *s, const int32_t count[MK_WIRE_JOINTS],
                          int32_t micro)
{
    if (s->sample % s->record_every == 0 && s->recorded < MK_STANDALONE_RECORDS)
        s->record[s->recorded++] =
            (struct mk_standalone_record){s->sample, {count[0], count[1]}, micro, s->phase};
    s->sample++;
}
