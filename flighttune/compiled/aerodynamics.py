# SPDX-License-Identifier: LGPL-2.1-or-later
"""Aerodynamic forces and moments: FGAerodynamics."""

from collections.abc import Sequence
from xml.etree.ElementTree import Element

from flighttune.compiled.functions import function
from flighttune.compiled.properties import RADIANS, Properties, Unsupported
from flighttune.compiled.trace import Number, different, select, symbolic
from flighttune.compiled.vectors import Vector, add, cross, times

_AXES = {
    name: place
    for names in ("DRAG SIDE LIFT ROLL PITCH YAW", "AXIAL SIDE NORMAL", "X Y Z")
    for place, name in enumerate(names.split())
}

_FORCES, _MOMENTS = (0, 1, 2), (3, 4, 5)

# Dynamic pressure above which the lift coefficient is computed, psf.
_MOVING = 1.0


def aerodynamics(now: Properties, root: Element) -> None:
    """Forces (lbf) and moments (lbf ft) in body axes, about the centre of gravity."""
    aero = root.find("aerodynamics")
    if aero is None:
        raise Unsupported("a model without aerodynamics")
    _lengths(now, aero)
    shift = aero.find("aero_ref_pt_shift_x/function")
    # Of several axes with one name the last one counts.
    axes = {_AXES[axis.get("name", "")]: axis for axis in aero.findall("axis")}
    own: list[Number] = [0.0] * 6
    at_cg: list[Number] = [0.0] * 6

    def add_up(places: Sequence[int]) -> None:
        for i in (place for place in places if place in axes):
            for part in axes[i].findall("function"):
                sums = at_cg if part.get("apply_at_cg") == "true" else own
                sums[i] = sums[i] + function(now, part)

    names = {axis.get("name", "") for axis in aero.findall("axis")}
    frames = {axis.get("frame", "").upper() for axis in aero.findall("axis") if axis.get("frame")}
    if frames - {"BODY"} or len(names & {"LIFT", "DRAG", "AXIAL", "NORMAL", "X", "Y", "Z"}) < 1:
        raise Unsupported("axes of aerodynamics in a frame of their own")
    add_up(_FORCES)
    forces = _in_body_axes(now, own[:3], names)
    arm = now.reference_point
    if shift is not None:
        by = function(now, shift) * now["metrics/cbarw-ft"]
        arm = [arm[0] - by, arm[1], arm[2]]
    add_up(_MOMENTS)
    moments = add(own[3:], cross(arm, forces))
    if symbolic(*at_cg[:3]):
        forces = add(forces, _in_body_axes(now, at_cg[:3], names))
    now.forces["aero"], now.moments["aero"] = forces, moments
    now["_lift"] = -times(now.body_to_wind, forces)[2]


def _lengths(now: Properties, aero: Element) -> None:
    """Lengths, areas and stall signals that functions read besides flow and controls."""
    qbar, area = now["aero/qbar-psf"], now["metrics/Sw-sqft"]
    coefficient = now["_lift"] / (area * qbar)
    squared = select(qbar > _MOVING, coefficient * coefficient, now["aero/cl-squared"])
    now["aero/cl-squared"] = squared
    # Functions outside the axes see the lengths of the previous step.
    for part in aero.findall("function"):
        if part.get("type") in (None, "pre"):
            function(now, part)
    twice = 2 * now["velocities/vt-fps"]
    for name, length in (("aero/bi2vel", "metrics/bw-ft"), ("aero/ci2vel", "metrics/cbarw-ft")):
        new = now[length] / twice
        # Before its first state of flight an aircraft is at rest.
        now[name] = select(different(twice, 0.0), new, now[name]) if now.trimming else new
    alpha = now["aero/alpha-rad"]
    now["aero/alpha-wing-rad"] = alpha + now["metrics/iw-rad"]
    now["aero/qbar-area"] = area * qbar
    stall = aero.find("alphalimits")
    if stall is not None:
        unit = 1.0 if stall.get("unit", "RAD") == "RAD" else RADIANS
        limit = float(stall.findtext("max") or "nan") * unit
        near = 10 * (alpha / limit - 0.85)
        now["systems/stall-warn-norm"] = select(alpha > 0.85 * limit, near, 0.0)
    limits = aero.find("hysteresis_limits")
    if limits is not None:
        unit = 1.0 if limits.get("unit", "RAD") == "RAD" else RADIANS
        low, high = (float(limits.findtext(end) or "nan") * unit for end in ("min", "max"))
        before = now["aero/stall-hyst-norm"]
        stalled = select(alpha > high, 1.0, select(alpha < low, 0.0, before))
        now["aero/stall-hyst-norm"] = stalled


def _in_body_axes(now: Properties, forces: Vector, axes: set[str]) -> Vector:
    if axes & {"LIFT", "DRAG"}:
        return times(now.wind_to_body, [-forces[0], forces[1], -forces[2]])
    if axes & {"AXIAL", "NORMAL"}:
        return [-forces[0], forces[1], -forces[2]]
    return forces
