
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

/* Speed has priority: where n_x_most, what the engines give, cannot carry the climb through the air, the path
 * angle over ground gives way. Returns the one to follow, without rates where it is another. `wind`: as an
 * aircraft knows it, behind a filter of ${wind_s} s, say; zeros in still air. */
double ft_path_angle(double gamma_ref, double V_ref, double chi, double V_a, double n_x_most,
                     const double *wind)
{
    const double bound = n_x_most + ${priority_per_g} * (V_a - ${least_share} * V_ref);
    const double sine = fmin(fmax(bound, ${steepest_dive}), 1.0), gamma = asin(sine);
    const double up = V_a * sine, level = V_a * cos(gamma), climb = up - wind[2];
    const double across = wind[1] * cos(chi) - wind[0] * sin(chi);
    const double ahead = sqrt(fmax(level * level - across * across, 0.0));
    const double along = fmax(wind[0] * cos(chi) + wind[1] * sin(chi) + ahead, ${least_speed} * level);
    return fmin(gamma_ref, gamma + atan2(climb * level - up * along, along * level + up * climb));
}
