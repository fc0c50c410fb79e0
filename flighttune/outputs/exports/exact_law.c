/* Outer loop of ${title}, gains ${gains}; made by flighttune ${version}.${notes}
 *
 * The exact law, from errors of course and flight-path angle to commands of roll and load factor: PI of
 * the errors and the rates of the reference give the rates wanted; inverting the point mass gives roll and
 * load factor; what the aircraft lacks of them is fed back; limits on size and rate.
 *
 * Units: rad, m/s, s; load factor in weights, +1 in level flight. Course chi clockwise from north,
 * path angle gamma up, roll phi right wing down; any course of a full turn will do.
 *
 * Use: call ft_outer_loop_start with the commands that are in force, then ft_outer_loop_step every
 * FT_DT seconds; it leaves the commands in `u`, held until the next sample.
 * One struct per aircraft; no other memory, no allocation.
 *
 * C99 and its <math.h>. Without contraction of multiply and add (-std=c99 or -ffp-contract=off) the
 * commands are those of flighttune's ExactLaw to the bit, but for the last bit of a function where the C
 * library's is another one.
 */
#include <math.h>

#define FT_DT ${dt}               /* sample time, s */
#define FT_CONDITIONAL ${conditional}         /* integrators stand while a limit holds */
#define FT_TRACKING_GAIN ${tracking_gain} /* sample time over tracking time; 0: no back-calculation */
#define FT_PER_G ${per_g}     /* 1 / acceleration of gravity, s^2/m */
#define FT_LIFT_FLOOR ${lift_floor}     /* weights: the least vertical lift for which roll is computed */
#define FT_COURSE_FIRST ${course_first}    /* the course has priority where lift is short */
/* Twice the parts of the rate limits that catch the course and the path angle */
#define FT_TURN_BRAKE ${turn_brake}
#define FT_BRAKE ${brake}

/* Rows: course, path angle; columns: errors of both */
static const double K_P[2][2] = {${K_P}};
static const double K_I[2][2] = {${K_I}}; /* times FT_DT */
/* Of roll and load factor: on what is measured, range, and how far a command may move in a sample */
static const double feedback[2] = {${feedback}};
static const double lower[2] = {${lower}}, upper[2] = {${upper}};
static const double step_down[2] = {${step_down}}, step_up[2] = {${step_up}};

struct ft_outer_loop {
    double u[2];        /* commands in force: phi in rad, n_z */
    double integral[2]; /* rates of course and path angle from the integrators, rad/s */
    double expected[2]; /* commands before the feedback */
};

/* One sample: a reference with its rates, and what is measured. The rates are those FT_LEAD_PHI and
 * FT_LEAD_N_Z seconds ahead, 0 if they are not planned. V_turn (m/s) is the speed that lift turns: the
 * airspeed in still air; in wind V_g / cos(delta), delta between the velocities over ground and through
 * the air. n_z is used where it is fed back. */
#define FT_LEAD_PHI ${lead_phi}
#define FT_LEAD_N_Z ${lead_n_z}
struct ft_sample {
    double chi_ref, gamma_ref, chi_rate, gamma_rate;
    double chi, gamma, phi, n_z, V_turn;
};

static double shorter_way_round(double angle)
{
    const double half_turn = 3.141592653589793, turn = 6.283185307179586;
    double rest = fmod(half_turn - angle, turn);
    if (rest < 0.0)
        rest += turn;
    return half_turn - rest;
}

/* A command after its limits; `held` becomes 1 where they change it. */
static double limited(int i, double wanted, double before, int *held)
{
    /* The reach of one sample, cut to the range; where they do not meet the rate limit rules. */
    double low = before + step_down[i], high = before + step_up[i], u;
    if (!(low > lower[i]))
        low = lower[i] < high ? lower[i] : high;
    if (!(high < upper[i]))
        high = upper[i] > low ? upper[i] : low;
    u = wanted < low ? low : wanted > high ? high : wanted;
    if (wanted - u != 0.0)
        *held = 1;
    return u;
}

static double roll_of_lift(double a, double b)
{
    const double most = upper[1] > 1e-9 ? upper[1] : 1e-9;
    if (b < FT_LIFT_FLOOR)
        return atan2(a, FT_LIFT_FLOOR);
    if (!(a * a + b * b > most * most))
        return atan2(a, b);
    /* The largest load factor does not give both. */
    return copysign(FT_COURSE_FIRST ? asin(fmin(1.0, fabs(a) / most)) : acos(fmin(1.0, b / most)), a);
}

void ft_outer_loop_start(struct ft_outer_loop *loop, double phi, double n_z)
{
    const struct ft_outer_loop engaged = {{phi, n_z}, {0.0, 0.0}, {phi, n_z}};
    *loop = engaged;
}

/* The command with what is lacking of the one expected, and the one expected that would have led to it */
static double fed_back(struct ft_outer_loop *loop, int i, double measured, int *held)
{
    const double k = feedback[i], expected = loop->expected[i], before = loop->u[i];
    loop->u[i] = expected;
    if (k == 0.0)
        return expected;
    loop->u[i] = limited(i, expected + k * (expected - measured), before, held);
    return (loop->u[i] + k * measured) / (1.0 + k);
}

${speed_priority}void ft_outer_loop_step(struct ft_outer_loop *loop, const struct ft_sample *now)
{
    const double e_chi = shorter_way_round(now->chi_ref - now->chi);
    const double e_gamma = now->gamma_ref - now->gamma;
    const double level = cos(now->gamma), speed = now->V_turn * FT_PER_G;
    const double turn = K_P[0][0] * e_chi + K_P[0][1] * e_gamma;
    double climb = K_P[1][0] * e_chi + K_P[1][1] * e_gamma;
    double chi_rate = now->chi_rate + K_P[0][0] * e_chi + K_P[0][1] * e_gamma + loop->integral[0];
    double gamma_rate, more[2], a, b, phi, n_z;
    int held[2] = {0, 0}, floored;
    /* Roll and load factor can take back a turn and a climb only at their own rate limits. */
    const int turn_braked = fabs(turn) * speed * level * K_P[0][0] > FT_TURN_BRAKE;
    const int braked = fabs(climb) * speed * K_P[1][1] > FT_BRAKE;
    if (turn_braked)
        chi_rate = now->chi_rate + loop->integral[0]
                   + copysign(sqrt(FT_TURN_BRAKE * fabs(turn) / (speed * level * K_P[0][0])), turn);
    if (braked)
        climb = copysign(sqrt(FT_BRAKE * fabs(climb) / (speed * K_P[1][1])), climb);
    gamma_rate = now->gamma_rate + climb + loop->integral[1];

    /* Horizontal and vertical lift that these rates need, in weights */
    a = speed * level * chi_rate;
    b = speed * gamma_rate + level;
    floored = b < FT_LIFT_FLOOR;
    loop->expected[0] = limited(0, roll_of_lift(a, b), loop->expected[0], &held[0]);
    loop->expected[1] = limited(1, b / cos(loop->expected[0]), loop->expected[1], &held[1]);
    phi = fed_back(loop, 0, now->phi, &held[0]);
    n_z = fed_back(loop, 1, now->n_z, &held[1]);

    /* Whether the commands give the rates wanted */
    held[0] = held[0] || turn_braked || floored;
    held[1] = held[1] || braked;
    more[0] = K_I[0][0] * e_chi + K_I[0][1] * e_gamma;
    more[1] = K_I[1][0] * e_chi + K_I[1][1] * e_gamma;
    if (FT_CONDITIONAL) {
        more[0] = held[0] ? 0.0 : more[0];
        more[1] = held[1] ? 0.0 : more[1];
    } else if (FT_TRACKING_GAIN != 0.0) {
        if (held[0] || held[1])
            more[0] -= FT_TRACKING_GAIN * (a - n_z * sin(phi)) / (speed * level);
        if (held[1])
            more[1] -= FT_TRACKING_GAIN * (b - n_z * cos(phi)) / speed;
    }
    loop->integral[0] += more[0];
    loop->integral[1] += more[1];
}
