/* Monitor ${title}; made by flighttune ${version}.
 *
 * Residuals are signals of an autopilot minus what healthy flights predict. The score is the largest
 * residual so far relative to its limit; a score above 1 is an alarm.
 * ${claim}
 *
 * Units: rad, m/s, s; load factor n_z in weights, surfaces and throttle as in the table of signals of
 * flighttune (docs/formats.md), *_err is reference minus actual. A signal that is missing in a sample
 * keeps its last value.
 *
 * Use: call ft_monitor_start, then ft_monitor_step every FT_MONITOR_DT seconds. One struct per
 * aircraft; no other memory, no allocation. C99 and its <math.h>.
 */
#include <math.h>

#define FT_MONITOR_DT ${dt} /* sample time, s */
#define FT_MODELS ${models}
#define FT_WATCHES ${watches} /* sets of weights and limits; all must alarm */
#define FT_TERMS ${terms}   /* of all models, the target of each last */
#define FT_LAGS ${lags}
#define FT_FIRST_JUDGED ${first_judged} /* samples before it only fill the lags */

struct ft_monitor_sample {
    double ${signals};
};

struct ft_monitor {
    double score;  /* largest so far, of the watch for which it is least */
    double at;     /* time of the alarm, s; negative without one */
    int why;       /* residual that alarms, see ft_monitor_name; negative without an alarm */
    long samples;
    double lag[FT_LAGS];
    double mean[FT_WATCHES][FT_MODELS];
    double past[FT_WATCHES][FT_MODELS];
    double largest[FT_WATCHES];
};

/* Model i has the terms first_term[i] to first_term[i + 1] */
static const int first_term[FT_MODELS + 1] = {${first_term}};
static const double weight[FT_WATCHES][FT_TERMS] = {${weights}};
static const double middle[FT_WATCHES][FT_MODELS] = {${middle}};
static const double half[FT_WATCHES][FT_MODELS] = {${half}};
static const double keep_term = ${keep_term}; /* of a lag over one sample */
static const double keep_mean[FT_MODELS] = {${keep_mean}};
static const double keep_past[FT_MODELS] = {${keep_past}}; /* 1 where the past is not subtracted */
static const double most[FT_MODELS] = {${most}}; /* of a residual: 0 where only a loss counts */

static double ft_lagged(struct ft_monitor *m, int i, double value)
{
    m->lag[i] = m->samples ? (1.0 - keep_term) * value + keep_term * m->lag[i] : value;
    return m->lag[i];
}

/* How fast a value changes, behind the lag */
static double ft_rate(struct ft_monitor *m, int i, double value)
{
    return (value - ft_lagged(m, i, value)) / ${lag_s};
}

const char *ft_monitor_name(int why)
{
    static const char *const names[FT_MODELS] = {${names}};
    return names[why];
}

void ft_monitor_start(struct ft_monitor *m)
{
    static const struct ft_monitor nothing = {0};
    *m = nothing;
    m->at = -1.0;
    m->why = -1;
}

/* Take the signals of a sample; return the score. */
double ft_monitor_step(struct ft_monitor *m, const struct ft_monitor_sample *s)
{
    double term[FT_TERMS], least = INFINITY;
    int w, i, j, why = -1;
${step}
    if (m->samples >= FT_FIRST_JUDGED) {
        for (w = 0; w < FT_WATCHES; w++) {
            double largest = 0.0;
            int by = 0;
            for (i = 0; i < FT_MODELS; i++) {
                double residual = 0.0, score;
                for (j = first_term[i]; j < first_term[i + 1]; j++)
                    residual += weight[w][j] * term[j];
                m->mean[w][i] = (1.0 - keep_mean[i]) * residual + keep_mean[i] * m->mean[w][i];
                if (m->samples == FT_FIRST_JUDGED && keep_past[i] < 1.0)
                    m->past[w][i] = residual;
                m->past[w][i] += (1.0 - keep_past[i]) * (residual - m->past[w][i]);
                residual = fmin(m->mean[w][i] - m->past[w][i], most[i]);
                score = fabs(residual - middle[w][i]) / half[w][i];
                if (score > largest) {
                    largest = score;
                    by = i;
                }
            }
            if (largest > 1.0 && !(m->largest[w] > 1.0))
                why = by;
            m->largest[w] = fmax(m->largest[w], largest);
            least = fmin(least, m->largest[w]);
        }
        m->score = least;
        if (least > 1.0 && m->why < 0) {
            m->at = (double)m->samples * FT_MONITOR_DT;
            m->why = why;
        }
    }
    m->samples++;
    return m->score;
}
