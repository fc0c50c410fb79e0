/* Outer loop of ${title}, gains ${gains}; made by flighttune ${version}.${notes}
 *
 * From errors of course and flight-path angle${airspeed_error} to commands of roll and load factor${n_x_command}:
 * u = limit(u_ff + K_P e + K_I integral of e), with limits on size and rate.
 *
 * Units: rad, m/s, s; load factor in weights, +1 in level flight. Course chi clockwise from north,
 * path angle gamma up, roll phi right wing down; any course of a full turn will do.
 *
 * Use: call ft_outer_loop_start with the commands that are in force, then ft_outer_loop_step${or_along}
 * every FT_DT seconds; it leaves the commands in `u`, held until the next sample.
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
#define FT_FEED_FORWARD ${feed_forward}        /* commands of steady flight at this bank */
#define FT_CHANNELS ${channels}            /* 3 with the airspeed, else 2 */

/* Rows: phi, n_z, n_x; columns: chi, gamma, V */
static const double K_P[FT_CHANNELS][FT_CHANNELS] = {${K_P}};
static const double K_I_half[FT_CHANNELS][FT_CHANNELS] = {${K_I}}; /* K_I FT_DT / 2 */
/* Range of each command, and how far it may move in a sample */
static const double lower[FT_CHANNELS] = {${lower}}, upper[FT_CHANNELS] = {${upper}};
static const double step_down[FT_CHANNELS] = {${step_down}}, step_up[FT_CHANNELS] = {${step_up}};

struct ft_outer_loop {
    double u[FT_CHANNELS];        /* commands in force: phi in rad, n_z, n_x */
    double integral[FT_CHANNELS]; /* their part from the integrator */
    double error[FT_CHANNELS];    /* of chi, gamma (rad) and V (over its reference), a sample ago */
    int started;
};

static double shorter_way_round(double angle)
{
    const double half_turn = 3.141592653589793, turn = 6.283185307179586;
    double rest = fmod(half_turn - angle, turn);
    if (rest < 0.0)
        rest += turn;
    return half_turn - rest;
}

static double limited(int i, double wanted, double before, double least, double most)
{
    /* The reach of one sample, cut to the range; where they do not meet the rate limit rules. */
    double low = before + step_down[i], high = before + step_up[i];
    int low_by_rate = low > least, high_by_rate = high < most;
    if (!low_by_rate)
        low = least < high ? least : high;
    if (!high_by_rate)
        high = most > low ? most : low;
    return wanted < low ? low : wanted > high ? high : wanted;
}

/* A step with these errors and feed-forward, each command in its range at this sample. */
static void step(struct ft_outer_loop *loop, const double *error, const double *u_ff,
                 const double *least, const double *most, double V_a)
{
    const double gain = FT_PER_SPEED != 0.0 ? V_a * FT_PER_SPEED : 1.0;
    double sum[FT_CHANNELS] = {0.0}; /* of two errors; the first sample has none before it */
    int i, j;
    for (j = 0; j < FT_CHANNELS; j++) {
        if (loop->started)
            sum[j] = loop->error[j] + error[j];
        loop->error[j] = error[j];
    }
    loop->started = 1;
    for (i = 0; i < FT_CHANNELS; i++) {
        double proportional = 0.0, increment = 0.0, before, wanted, excess, spare;
        for (j = 0; j < FT_CHANNELS; j++) {
            proportional += K_P[i][j] * error[j];
            increment += K_I_half[i][j] * sum[j];
        }
        increment *= gain;
        before = u_ff[i] + gain * proportional + loop->integral[i];
        wanted = before + increment;
        loop->u[i] = limited(i, wanted, loop->u[i], least[i], most[i]);
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

${speed_priority}#if FT_CHANNELS == 2
void ft_outer_loop_start(struct ft_outer_loop *loop, double phi, double n_z)
{
    const struct ft_outer_loop engaged = {{phi, n_z}, {0.0}, {0.0}, 0};
    *loop = engaged;
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
    step(loop, error, u_ff, lower, upper, V_a);
}

void ft_outer_loop_step(struct ft_outer_loop *loop, double chi_ref, double gamma_ref, double chi,
                        double gamma, double phi, double V_a)
{
    ft_outer_loop_step_along(loop, chi_ref, gamma_ref, 0.0, 0.0, V_a, chi, gamma, phi, V_a);
}
#else
/* Sine of the path angle through the air, which thrust bears, of a path over ground (rad) at V_a in a wind
 * (north, east, down, m/s) */
static double climb_through_air(double chi, double gamma, double V_a, const double *wind)
{
    const double level = cos(gamma), north = level * cos(chi), east = level * sin(chi);
    const double along = wind[0] * north + wind[1] * east - wind[2] * sin(gamma);
    const double across = wind[0] * wind[0] + wind[1] * wind[1] + wind[2] * wind[2] - along * along;
    const double ahead = V_a * V_a - across;
    if (!(ahead > 0.0)) /* a wind that no heading holds this course in */
        return sin(gamma);
    return sin(gamma) + (wind[2] + (fmax(along + sqrt(ahead), ${least_speed} * V_a) - V_a) * sin(gamma)) / V_a;
}

void ft_outer_loop_start(struct ft_outer_loop *loop, double phi, double n_z, double n_x)
{
    const struct ft_outer_loop engaged = {{phi, n_z, n_x}, {0.0}, {0.0}, 0};
    *loop = engaged;
}

/* n_x is thrust minus drag over weight, along the path. */
struct ft_sample {
    double chi_ref, gamma_ref, V_ref; /* rad, m/s */
    /* Their rates (rad/s, m/s^2); those of the angles FT_LEAD_PHI and FT_LEAD_N_Z ahead, 0 if not
     * planned, and V_turn (m/s), the speed that lift turns: V_a in still air; in wind V_g / cos(delta),
     * delta between the velocities over ground and through the air */
    double chi_rate, gamma_rate, V_rate, V_turn;
    double chi, gamma, phi, V_a;  /* measured */
    double n_x_least, n_x_most; /* what the engines give now */
    double wind[3];             /* as of ft_path_angle */
};

/* Returns the path angle that is followed: that of ft_path_angle. */
double ft_outer_loop_step(struct ft_outer_loop *loop, const struct ft_sample *now)
{
    const double gamma_ref = ft_path_angle(now->gamma_ref, now->V_ref, now->chi, now->V_a,
                                           now->n_x_most, now->wind);
    const int cut = gamma_ref < now->gamma_ref;
    const double climb = climb_through_air(now->chi, gamma_ref, now->V_a, now->wind);
    const double per_g = cut ? 0.0 : now->V_turn / FT_G;
    const double error[3] = {shorter_way_round(now->chi_ref - now->chi), gamma_ref - now->gamma,
                             (now->V_ref - now->V_a) / now->V_ref};
    const double lift = cos(gamma_ref) + now->gamma_rate * per_g;
    const double u_ff[3] = {FT_FEED_FORWARD ? atan(now->chi_rate * per_g) : 0.0,
                            FT_FEED_FORWARD ? lift / cos(now->phi) : 0.0,
                            FT_FEED_FORWARD ? climb + now->V_rate / FT_G : 0.0};
    /* Beyond the stop of the engines nothing winds up; a little of it keeps them at the stop. */
    const double least[3] = {lower[0], lower[1], fmax(lower[2], now->n_x_least - ${beyond_stop})};
    const double most[3] = {upper[0], upper[1], fmin(upper[2], now->n_x_most + ${beyond_stop})};
    step(loop, error, u_ff, least, most, now->V_a);
    return gamma_ref;
}
#endif
