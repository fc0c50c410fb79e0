"""The Aerosonde's equations of motion with its published coefficients, and factors on them."""

import math

import numpy as np
from airframes import off_nominal

FT, LBF = 0.3048, 4.4482216152605  # m, N
MASS, MOTOR = 11.0, 120.0  # kg, N
J = {"ixx": 0.8244, "iyy": 1.135, "izz": 1.759, "ixz": 0.1204}  # kg m2
S, SPAN, CHORD = 0.55, 2.8956, 0.18994
CG_AFT = 0.31 * CHORD  # m behind the point the coefficients refer to
SURFACES = "aileron", "elevator", "rudder"
RHO_1000_M = 1.1116  # ISA
NOMINAL = off_nominal()


def accelerations(V_a, alpha, beta, rates, surfaces, throttle, off=NOMINAL):
    """Body accelerations without gravity (m/s2) and angular accelerations (rad/s2)."""
    f = {name.rpartition("/")[2]: factor for name, factor in off.coefficient_factors.items()}

    def c(name, value):
        return f.get(name, 1.0) * value

    (p, q, r), (aileron, elevator, rudder) = rates, surfaces
    q_hat, p_hat, r_hat = q * CHORD / (2 * V_a), p * SPAN / (2 * V_a), r * SPAN / (2 * V_a)
    C_L = c("CL_alpha", 0.23 + 5.61 * alpha) + c("CL_q", 7.95 * q_hat)
    C_L = c("CL", C_L + c("CL_de", 0.13 * elevator))
    C_D = c("CD_0", 0.043) + c("CD_i", C_L**2 / (math.pi * 0.9 * SPAN**2 / S))
    C_D = C_D + c("CD_de", 0.0135 * abs(elevator))
    C_Y = c("CY_beta", -0.83 * beta) + c("CY_da", 0.075 * aileron) + c("CY_dr", 0.19 * rudder)
    C_l = c("Cl_beta", -0.13 * beta) + c("Cl_p", -0.51 * p_hat) + c("Cl_r", 0.25 * r_hat)
    C_l = C_l + c("Cl_da", 0.17 * aileron) + c("Cl_dr", 0.0024 * rudder)
    C_m = c("Cm_0", 0.0135) + c("Cm_alpha", -2.74 * alpha) + c("Cm_q", -38.21 * q_hat)
    C_m = C_m + c("Cm_de", -0.99 * elevator)
    C_n = c("Cn_beta", 0.073 * beta) + c("Cn_p", -0.069 * p_hat) + c("Cn_r", -0.095 * r_hat)
    C_n = C_n + c("Cn_da", -0.011 * aileron) + c("Cn_dr", -0.069 * rudder)
    pressure_area = 0.5 * RHO_1000_M * V_a**2 * S
    along_wind = np.array(
        [-off.drag_factor * C_D, off.side_force_factor * C_Y, -off.lift_factor * C_L]
    )
    aerodynamic = pressure_area * wind_to_body(alpha, beta) @ along_wind
    pull = np.array([off.thrust_factor * MOTOR * throttle, 0.0, 0.0])
    aft, right, down = off.cg_shift
    motor = np.array([aft, -right, -down])  # from the centre of gravity, body axes
    moment = pressure_area * np.array(
        [
            SPAN * off.roll_moment_factor * C_l,
            CHORD * off.pitch_moment_factor * C_m,
            SPAN * off.yaw_moment_factor * C_n,
        ]
    )
    moment += np.cross(motor + np.array([CG_AFT, 0.0, 0.0]), aerodynamic) + np.cross(motor, pull)
    xx, yy, zz, xz = (getattr(off, f"{name}_factor") * value for name, value in J.items())
    tensor = np.array([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])
    return (aerodynamic + pull) / (off.mass_factor * MASS), turning(tensor, moment, rates)


def wind_to_body(alpha, beta):
    ca, sa, cb, sb = math.cos(alpha), math.sin(alpha), math.cos(beta), math.sin(beta)
    return np.array([[ca * cb, -ca * sb, -sa], [sb, cb, 0.0], [sa * cb, -sa * sb, ca]])


def turning(tensor, moment, rates):
    """Angular accelerations of a rigid body (rad/s2)."""
    return np.linalg.solve(tensor, moment - np.cross(rates, tensor @ rates))


def measured(fdm):
    """Forces without gravity (N) and angular accelerations (rad/s2) of JSBSim, body axes."""
    force = [fdm.reader(f"forces/fb{axis}-total-lbs")() * LBF for axis in "xyz"]
    return force, [fdm.reader(f"accelerations/{rate}dot-rad_sec2")() for rate in "pqr"]


def evaluated(fdm, V_a, alpha, beta, rates, surfaces, throttle):
    """Put `fdm` into a state that no trim led to."""
    settings = {
        "ft/engaged": 0.0,
        "ic/h-sl-ft": 1000.0 / FT,
        "ic/u-fps": V_a / FT * math.cos(alpha) * math.cos(beta),
        "ic/v-fps": V_a / FT * math.sin(beta),
        "ic/w-fps": V_a / FT * math.sin(alpha) * math.cos(beta),
        "ic/p-rad_sec": rates[0],
        "ic/q-rad_sec": rates[1],
        "ic/r-rad_sec": rates[2],
        **{f"ft/{x}-trim-rad": y for x, y in zip(SURFACES, surfaces, strict=True)},
        "ft/throttle-trim-norm": throttle,
    }
    for name, value in settings.items():
        fdm.writer(name)(value)
    fdm.evaluate()
    return fdm
