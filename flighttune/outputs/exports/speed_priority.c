/* Speed has priority: where n_x_most, what the engines give, cannot carry the climb through the air at V_ref
 * (m/s), the path angle over ground gives way. Returns the one to follow, with a rate of 0 where it is less
 * than gamma_ref. `wind` (north, east, down, m/s): behind a filter of some ${wind_s} s; zeros in still air. */
double ft_path_angle(double gamma_ref, double V_ref, double chi, double V_a, double n_x_most,
                     const double *wind)
{
    const double bound = n_x_most + ${per_speed} * (V_a - ${least_share} * V_ref);
    const double sine = fmin(fmax(bound, ${steepest_dive}), 1.0), gamma = asin(sine);
    const double up = V_a * sine, level = V_a * cos(gamma), climb = up - wind[2];
    const double across = wind[1] * cos(chi) - wind[0] * sin(chi);
    const double ahead = sqrt(fmax(level * level - across * across, 0.0));
    const double along = fmax(wind[0] * cos(chi) + wind[1] * sin(chi) + ahead, ${least_speed} * level);
    return fmin(gamma_ref, gamma + atan2(climb * level - up * along, along * level + up * climb));
}

