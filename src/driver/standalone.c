#include "driver/standalone.h"

#include <math.h>
#include <string.h>

#include "driver/standalone_laws.h"

#define DEFAULT_TRAVEL 63.0f /* rad: ten turns */
#define TWO_PI 6.28318530718f
#define OBSERVER_RADPS 120.0f /* bandwidth of the speed estimate */

static const struct mk_law *find(enum mk_controller c)
{
    return (unsigned)c < MK_CONTROLLER_COUNT ? mk_laws[c] : NULL;
}

int mk_standalone_gain_count(enum mk_controller controller)
{
    const struct mk_law *law = find(controller);
    return law ? law->gains : 0;
}

bool mk_standalone_setup(struct mk_standalone *s, enum mk_controller controller, uint32_t period_us,
                         uint32_t record_every)
{
    const struct mk_law *law = find(controller);
    if (!law)
        return false;
    s->controller = controller;
    s->period_us = period_us;
    s->record_every = record_every;
    memcpy(s->gain, law->initial, sizeof s->gain);
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
    s->going_round = false;
    memset(s->speed, 0, sizeof s->speed);
    memset(s->acceleration, 0, sizeof s->acceleration);
}

static int32_t counted(int32_t now, int32_t before, int bits)
{
    uint32_t d = ((uint32_t)now - (uint32_t)before) << (32 - bits);
    return (int32_t)d >> (32 - bits);
}

float mk_standalone_follow(struct mk_standalone *s, int joint, int32_t count, int bits, int32_t cpr)
{
    if (s->sample == 0)
        s->total[joint] = count;
    else
        s->total[joint] += counted(count, s->raw[joint], bits);
    s->raw[joint] = count;
    int32_t turns = s->total[joint] / cpr;
    if (mk_laws[s->controller]->wheel[joint] && turns != 0) {
        s->total[joint] -= turns * cpr;
        s->angle[joint] -= TWO_PI * (float)turns;
    }
    return (float)s->total[joint] * (TWO_PI / (float)cpr);
}

/* Angle, speed and acceleration by a critically damped g-h-k filter, which does not lag behind a
 * steady acceleration: the energy that swing-ups look at would otherwise be off by a tenth. */
static void observe(struct mk_standalone *s, const float q[MK_WIRE_JOINTS])
{
    float dt = (float)s->period_us * 1e-6f, z = expf(-OBSERVER_RADPS * dt);
    float g = 1.0f - z * z * z, h = 1.5f * (1.0f - z * z) * (1.0f - z);
    float k = 0.5f * (1.0f - z) * (1.0f - z) * (1.0f - z);
    for (int j = 0; j < MK_WIRE_JOINTS; j++) {
        if (s->sample == 0)
            s->angle[j] = q[j];
        float angle = s->angle[j] + dt * (s->speed[j] + 0.5f * dt * s->acceleration[j]);
        float speed = s->speed[j] + dt * s->acceleration[j];
        float error = q[j] - angle;
        s->angle[j] = angle + g * error;
        s->speed[j] = speed + h / dt * error;
        s->acceleration[j] += 2.0f * k / (dt * dt) * error;
    }
}

float mk_standalone_step(struct mk_standalone *s, const float q[MK_WIRE_JOINTS])
{
    observe(s, q);
    return mk_laws[s->controller]->step(s);
}

bool mk_standalone_out_of_travel(const struct mk_standalone *s)
{
    const struct mk_law *law = mk_laws[s->controller];
    for (int j = 0; j < MK_WIRE_JOINTS; j++)
        if (!law->wheel[j] && !(s->angle[j] > -DEFAULT_TRAVEL && s->angle[j] < DEFAULT_TRAVEL))
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
