/* Outer loop of ${title}, gains ${gains}; made by flighttune ${version}.
 *
 * From errors of course and flight-path angle to commands of roll and load factor:
 * u = limit(u_ff + K_P e + K_I integral of e), with limits on size and rate.
 *
 * Units: rad, m/s, s; load factor in weights, +1 in level flight. Course chi clockwise from north,
 * path angle gamma up, roll phi right wing down; any course of a full turn will do.
 *
 * Use: call ft_outer_loop_start with the roll and the load factor that are in force, then
 * ft_outer_loop_step (or ft_outer_loop_step_along) every FT_DT seconds; it leaves the commands in `u`, held until the next sample.
 * One struct per aircraft; no other memory, no allocation. ${uses_V_a}
 *
 * C99 and its <math.h>. Without contraction of multiply and add (-std=c99 or -ffp-contract=off) the
 * commands are those of flighttune's MimoPI to the bit, but for the last bit of a cosine where the C
 * library's is another one.
 */
#include <math.h>

#define FT_DT ${dt}               /* sample time, s */
#define FT_CONDITIONAL ${conditional}         /* anti-windup takes only what the limits let through */
#define FT_TRACKING_GAIN ${tracking_gain} /* sample time over tracking time; 0: no back-calculation */
#define FT_PER_SPEED ${per_speed}     /* 1 / airspeed the gains are for, s/m; 0: unscheduled */
#define FT_G ${g}              /* acceleration of gravity, m/s^2 */
#define FT_LEAD_PHI ${lead_phi}     /* lags of roll and load factor, s */
#define FT_LEAD_N_Z ${lead_n_z}
#define FT_FEED_FORWARD ${feed_forward}        /* load factor of steady flight at this bank */

/* Rows: phi, n_z; columns: chi, gamma */
static const double K_P[2][2] = {${K_P}};
static const double K_I_half[2][2] = {${K_I_half}}; /* K_I FT_DT / 2 */
/* Range of each command, and how far it may move in a sample */
static const double lower[2] = {${lower}}, upper[2] = {${upper}};
static const double step_down[2] = {${step_down}}, step_up[2] = {${step_up}};

struct ft_outer_loop {
    double u[2];        /* commands in force: phi in rad, n_z */
    double integral[2]; /* their part from the integrator */
    double error[2];    /* of chi and gamma at the sample before, rad */
    int started;
};

void ft_outer_loop_start(struct ft_outer_loop *loop, double phi, double n_z)
{
    const struct ft_outer_loop empty = {{0.0, 0.0}, {0.0, 0.0}, {0.0, 0.0}, 0};
    *loop = empty;
    loop->u[0] = phi;
    loop->u[1] = n_z;
}

static double shorter_way_round(double angle)
{
    const double half_turn = 3.141592653589793, turn = 6.283185307179586;
    double rest = fmod(half_turn - angle, turn);
    if (rest < 0.0)
        rest += turn;
    return half_turn - rest;
}

static double limited(int i, double wanted, double before)
{
    /* The reach of one sample, cut to the range; where they do not meet the rate limit rules. */
    double low = before + step_down[i], high = before + step_up[i];
    int low_by_rate = low > lower[i], high_by_rate = high < upper[i];
    if (!low_by_rate)
        low = lower[i] < high ? lower[i] : high;
    if (!high_by_rate)
        high = upper[i] > low ? upper[i] : low;
    return wanted < low ? low : wanted > high ? high : wanted;
}

/* A step along a reference with rates (rad/s), FT_LEAD_PHI and FT_LEAD_N_Z ahead: roll and lift are
 * planned for them at V_turn (m/s), the speed that lift turns. In still air that is V_a; in wind it is
 * V_g / cos(delta), delta between the velocities over ground and through the air. */
void ft_outer_loop_step_along(struct ft_outer_loop *loop, double chi_ref, double gamma_ref,
                              double chi_rate, double gamma_rate, double V_turn, double chi,
                              double gamma, double phi, double V_a)
{
    const double error[2] = {shorter_way_round(chi_ref - chi), gamma_ref - gamma};
    const double lift = cos(gamma_ref) + gamma_rate * (V_turn / FT_G);
    const double u_ff[2] = {FT_FEED_FORWARD ? atan(chi_rate * (V_turn / FT_G)) : 0.0,
                            FT_FEED_FORWARD ? lift / cos(phi) : 0.0};
    const double gain = FT_PER_SPEED != 0.0 ? V_a * FT_PER_SPEED : 1.0;
    double sum[2] = {0.0, 0.0}; /* of two errors; the first sample has none before it */
    int i, j;
    for (j = 0; j < 2; j++) {
        if (loop->started)
            sum[j] = loop->error[j] + error[j];
        loop->error[j] = error[j];
    }
    loop->started = 1;
    for (i = 0; i < 2; i++) {
        double proportional = 0.0, increment = 0.0, before, wanted, excess, spare;
        for (j = 0; j < 2; j++) {
            proportional += K_P[i][j] * error[j];
            increment += K_I_half[i][j] * sum[j];
        }
        increment *= gain;
        before = u_ff[i] + gain * proportional + loop->integral[i];
        wanted = before + increment;
        loop->u[i] = limited(i, wanted, loop->u[i]);
        excess = wanted - loop->u[i];
        if (excess != 0.0) {
            if (FT_CONDITIONAL && increment * excess > 0.0) {
                spare = loop->u[i] - before;
                increment = increment * spare > 0.0 ? spare : 0.0;
            }
            increment -= FT_TRACKING_GAIN * excess;
        }
        loop->integral[i] += increment;
    }
}

void ft_outer_loop_step(struct ft_outer_loop *loop, double chi_ref, double gamma_ref, double chi,
                        double gamma, double phi, double V_a)
{
    ft_outer_loop_step_along(loop, chi_ref, gamma_ref, 0.0, 0.0, V_a, chi, gamma, phi, V_a);
}
