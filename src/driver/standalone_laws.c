/* Swing-ups and balancing laws in single precision. Angles are counted from the hanging rest; the
 * laws are those of src/ctrl, without what a small processor cannot pay for: the hand-over looks at
 * the report's box of angles and command instead of a region of attraction. */
#include "driver/standalone_laws.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265f
#define GRAVITY 9.81f
#define FRICTION_STEEPNESS 15.0f
#define PATIENCE_S 1.5f /* then the pump tries another strength */

static float clamp(float x, float limit)
{
    return x > limit ? limit : x < -limit ? -limit : x;
}

static float wrap(float x)
{
    return remainderf(x, 2.0f * PI);
}

static float friction(const float *p, float v)
{
    return p[0] * v + p[1] * tanhf(FRICTION_STEEPNESS * v);
}

/* --- two links: pendubot and Furuta pendulum
 * ------------------------------------------------------- The energy of the free link is pumped by
 * accelerating the driven one (src/ctrl/link_pump.h). */

enum {
    K_Q1,
    K_V1,
    K_Q2,
    K_V2,
    P, /* p1 .. p7; the Furuta pendulum has six */
    STRENGTH = P + 7,
    SHARPNESS,
    REACH,
    HOLD_P,
    HOLD_D,
    HOLD_SPEED,
    CENTRE_P,
    CENTRE_D,
    BOX_Q1,
    BOX_Q2,
    BOX_U,
    LINK_GAINS
};

struct links {
    float e1, e2, v1, v2;          /* away from the equilibrium */
    float d11, d12, d22, h1, h2;   /* mass matrix; everything else */
    float energy, swing, coupling; /* of the free link: energy in m g l, 0 upright; scaled speed */
};

static struct links pendubot_links(const struct mk_standalone *s, float target)
{
    const float *p = s->gain + P;
    float q1 = s->angle[0] - 0.5f * PI, q2 = s->angle[1], v1 = s->speed[0], v2 = s->speed[1];
    float upright = 0.5f * PI - target; /* of link 2, relative to link 1 at its target */
    float c2 = cosf(q2), s2 = sinf(q2), weight = p[4] * GRAVITY, w = v1 + v2;
    return (struct links){
        .e1 = wrap(q1 - target),
        .e2 = wrap(q2 - upright),
        .v1 = v1,
        .v2 = v2,
        .d11 = p[0] + p[1] + 2.0f * p[2] * c2,
        .d12 = p[1] + p[2] * c2,
        .d22 = p[1],
        .h1 = -p[2] * s2 * (2.0f * v1 + v2) * v2 + p[3] * GRAVITY * cosf(q1) +
              weight * cosf(q1 + q2) + friction(p + 5, v1),
        .h2 = p[2] * s2 * v1 * v1 + weight * cosf(q1 + q2),
        .energy = 0.5f * p[1] * w * w / weight + sinf(q1 + q2) - 1.0f,
        .swing = w * sqrtf(p[1] / weight),
        .coupling = c2,
    };
}

static struct links furuta_links(const struct mk_standalone *s)
{
    const float *p = s->gain + P;
    float b = s->angle[1] + PI, v1 = s->speed[0], v2 = s->speed[1];
    float cb = cosf(b), sb = sinf(b), weight = p[3] * GRAVITY, inertia = 4.0f * p[2];
    return (struct links){
        .e1 = s->angle[0],
        .e2 = wrap(b),
        .v1 = v1,
        .v2 = v2,
        .d11 = p[0] + inertia * sb * sb,
        .d12 = 0.5f * p[1] * cb,
        .d22 = inertia,
        .h1 = 2.0f * inertia * sb * cb * v1 * v2 - 0.5f * p[1] * sb * v2 * v2 + friction(p + 4, v1),
        .h2 = -inertia * sb * cb * v1 * v1 - weight * sb,
        .energy = 0.5f * inertia * v2 * v2 / weight + cb - 1.0f,
        .swing = v2 * sqrtf(inertia / weight),
        .coupling = cb,
    };
}

/* Acceleration of link 1 that pumps link 2 up and keeps link 1 about its target. */
static float pump(const struct mk_standalone *s, const struct links *l)
{
    static const float strength[] = {1.0f, 0.75f, 1.25f, 0.9f};
    static const float aim[] = {0.0f, 0.05f, -0.05f, 0.1f};
    const float *k = s->gain;
    float since = (float)s->sample * (float)s->period_us * 1e-6f;
    unsigned turn = (unsigned)(since / PATIENCE_S) % 4u;
    float lead = clamp(-k[HOLD_P] / k[HOLD_D] * l->e1, k[HOLD_SPEED]);
    float hold = k[HOLD_D] * (lead - l->v1);
    if (fabsf(l->e1) > k[REACH])
        return hold;
    float share = clamp(k[SHARPNESS] * (l->energy - aim[turn]) * l->swing * l->coupling, 1.0f);
    if (fabsf(l->swing) < 0.04f && l->energy < -1.8f)
        share = -1.0f; /* at rest below there is nothing to pump on: the first push */
    return k[STRENGTH] * strength[turn] * share + (1.0f - fabsf(share)) * hold -
           k[CENTRE_P] * l->e1 - k[CENTRE_D] * l->v1;
}

static float drive_links(struct mk_standalone *s, const struct links *l)
{
    const float *k = s->gain;
    float u = -(k[K_Q1] * l->e1 + k[K_V1] * l->v1 + k[K_Q2] * l->e2 + k[K_V2] * l->v2);
    bool near = fabsf(l->e1) < k[BOX_Q1] && fabsf(l->e2) < k[BOX_Q2] && fabsf(u) < k[BOX_U];
    bool held = s->phase == MK_STANDALONE_BALANCE && fabsf(l->e1) < 2.5f && fabsf(l->e2) < 1.2f;
    s->phase = near || held ? MK_STANDALONE_BALANCE : MK_STANDALONE_SWINGUP;
    if (s->phase == MK_STANDALONE_BALANCE)
        return u;
    return (l->d11 - l->d12 * l->d12 / l->d22) * pump(s, l) + l->h1 - l->d12 / l->d22 * l->h2;
}

static float pendubot_mid(struct mk_standalone *s)
{
    struct links l = pendubot_links(s, -0.5f * PI);
    return drive_links(s, &l);
}

static float pendubot_top(struct mk_standalone *s)
{
    struct links l = pendubot_links(s, 0.5f * PI);
    return drive_links(s, &l);
}

static float furuta(struct mk_standalone *s)
{
    struct links l = furuta_links(s);
    return drive_links(s, &l);
}

/* --- reaction wheel: report (2.27), (2.31), (2.56)
 * -------------------------------------------------- */

enum {
    K_PP,
    K_DP,
    K_DR,
    WHEEL_P, /* p1 .. p5 */
    K_E = WHEEL_P + 5,
    K_V,
    K_U,
    KICK,
    WHEEL_LIMIT, /* rad/s: a pendulum that goes round with the wheel this fast is stopped */
    BOX,
    BOX_WHEEL_U,
    WHEEL_GAINS
};

/* A pendulum that has gone over the top with the wheel at its limit would go round for ever: the
 * wheel takes where the pendulum is fast, below, and gives back where it is slow, above. */
static float stop_going_round(const float *k, float th, float v, float w)
{
    float way = v > 0.0f ? 1.0f : -1.0f;
    float wheel = way * w / (0.5f * k[WHEEL_LIMIT]);
    return way * k[KICK] * clamp(3.0f * (cosf(th) - wheel), 1.0f);
}

static float swing_wheel(struct mk_standalone *s, float th, float v, float w)
{
    const float *k = s->gain, *p = k + WHEEL_P;
    float top = 2.0f * p[2] * GRAVITY;
    float energy = 0.5f * p[0] * v * v + p[2] * GRAVITY * (1.0f - cosf(th));
    bool over = energy > top, at_limit = fabsf(w) > k[WHEEL_LIMIT];
    s->going_round = over && (s->going_round || at_limit);
    if (s->going_round)
        return stop_going_round(k, th, v, w);
    if (energy < 0.004f * top)
        return v > 0.0f ? -k[KICK] : k[KICK];
    return -clamp(k[K_U] * (k[K_V] * w - k[K_E] * (energy - top) * v), k[KICK]);
}

static float reaction_wheel(struct mk_standalone *s)
{
    const float *k = s->gain;
    float th = s->angle[0], v = s->speed[0], w = v + s->speed[1], e = wrap(th - PI);
    float u = -(k[K_PP] * e + k[K_DP] * v + k[K_DR] * w);
    bool near = fabsf(e) < k[BOX] && fabsf(u) < k[BOX_WHEEL_U];
    bool held = s->phase == MK_STANDALONE_BALANCE && fabsf(e) < 0.8f;
    s->phase = near || held ? MK_STANDALONE_BALANCE : MK_STANDALONE_SWINGUP;
    if (s->phase != MK_STANDALONE_BALANCE)
        u = swing_wheel(s, th, v, w);
    return u + friction(k + WHEEL_P + 3, s->speed[1]);
}

/* --- pi-speed: gains kp, ki, reference (rad/s)
 * ------------------------------------------------------ */

#define PI_INTEGRAL_LIMIT 10.0f /* command units */

static float pi_speed(struct mk_standalone *s)
{
    const float *k = s->gain;
    float error = k[2] - s->speed[0];
    s->phase = MK_STANDALONE_TRACK;
    s->integral += k[1] * error * (float)s->period_us * 1e-6f;
    s->integral = clamp(s->integral, PI_INTEGRAL_LIMIT);
    return k[0] * error + s->integral;
}

/* --- the table
 * ------------------------------------------------------------------------------------- */

/* clang-format off */
#define PENDUBOT_P 0.0540f, 0.0540f, 0.0286f, 0.7805f, 0.3284f, 0.1346f, 0.2014f

static const struct mk_law pendubot_mid_law = {
    .gains = LINK_GAINS, .step = pendubot_mid,
    .initial = {88.34f, 8.90f, 107.14f, 13.69f, PENDUBOT_P,
                50.0f, 11.0f, 1.2f, 165.0f, 7.5f, 10.5f, 8.0f, 2.2f, 0.3f, 0.3f, 20.0f}};

static const struct mk_law pendubot_top_law = {
    .gains = LINK_GAINS, .step = pendubot_top,
    .initial = {-219.2f, -35.87f, -211.2f, -27.22f, PENDUBOT_P,
                58.0f, 19.0f, 1.2f, 325.0f, 15.0f, 6.0f, 37.0f, 7.5f, 0.45f, 0.45f, 38.0f}};

static const struct mk_law furuta_law = {
    .gains = LINK_GAINS, .step = furuta,
    .initial = {-1.159f, -2.167f, -71.01f, -8.852f,
                0.0540f, 0.0572f, 0.0135f, 0.3284f, 0.1346f, 0.2014f, 0.0f,
                45.0f, 7.5f, 1.2f, 100.0f, 14.0f, 15.0f, 12.0f, 1.8f, 1.0f, 0.3f, 15.0f}};

static const struct mk_law reaction_wheel_law = {
    .gains = WHEEL_GAINS, .step = reaction_wheel, .wheel = {false, true},
    .initial = {-232.1f, -26.15f, -0.0411f, 0.8544f, 0.0045f, 6.864f, 0.0112f, 0.3487f,
                4000.0f, 4.0f, 0.4f, 10.0f, 450.0f, 0.5f, 15.0f}};

static const struct mk_law pi_speed_law = {
    .gains = 3, .step = pi_speed, .wheel = {true, true}, .initial = {0.15f, 0.75f, 50.0f}};
/* clang-format on */

const struct mk_law *const mk_laws[MK_CONTROLLER_COUNT] = {
    [MK_CONTROLLER_PENDUBOT_MID] = &pendubot_mid_law,
    [MK_CONTROLLER_PENDUBOT_TOP] = &pendubot_top_law,
    [MK_CONTROLLER_REACTION_WHEEL] = &reaction_wheel_law,
    [MK_CONTROLLER_FURUTA] = &furuta_law,
    [MK_CONTROLLER_PI_SPEED] = &pi_speed_law,
};
