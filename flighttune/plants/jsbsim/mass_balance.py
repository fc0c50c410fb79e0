"""Mass, centre of gravity and inertia of an aircraft off the nominal, load and fuel aboard."""

from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import InputError, PlantError
from flighttune.plants.jsbsim.aircraft import AircraftConfig
from flighttune.plants.jsbsim.model_text import placeholder
from flighttune.plants.jsbsim.off_nominal import OffNominal
from flighttune.units import FT, SLUG

_FEET_IN = {"IN": 1.0 / 12.0, "FT": 1.0, "M": 1.0 / FT}
_SLUG_FT2_IN = {"SLUG*FT2": 1.0, "KG*M2": 1.0 / (SLUG * FT * FT)}
_KG_M2 = SLUG * FT * FT
_INCHES = 12.0

_INERTIA = {
    "ixx": (0, 0),
    "iyy": (1, 1),
    "izz": (2, 2),
    "ixy": (0, 1),
    "ixz": (0, 2),
    "iyz": (1, 2),
}
_SIGN = {"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "ixy": 1.0, "ixz": -1.0, "iyz": 1.0}
"""Entry of the tensor over what stands in the file with negated_crossproduct_inertia="false"."""

_TRIANGLE = 1e-9
"""Share of the largest inertia by which rounding may break the triangle inequality."""

_LUMPS = 1e-6
"""Share of the mass above which load and fuel count."""

_ANY_RATE_HZ = 200.0
"""Rate of an aircraft that is weighed and not flown."""


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """Weight (lbf), centre of gravity (ft: aft, right, up) and inertia about it (slug ft^2, body).

    The inertia is a tensor: its products have a minus sign.
    """

    weight: float
    cg: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class MassBalance:
    """The whole aircraft as JSBSim weighs it, and the part of it whose numbers can be set.

    Attributes
    ----------
    whole, empty : body
        With load and fuel, and without.
    pounds_per_slug : float, 1
        As JSBSim has it.
    """

    whole: _Body
    empty: _Body
    pounds_per_slug: float

    def values(self, off: OffNominal) -> dict[str, float]:
        """Numbers of the empty aircraft that make the whole one as `off` says.

        Parameters
        ----------
        off : OffNominal
            Factors on the whole aircraft, and the shift of its centre of gravity.

        Returns
        -------
        dict of str to float, lbf, in and slug ft^2
            By the placeholders of `open_mass_balance`, in its units.

        Raises
        ------
        InputError
            If load and fuel alone weigh as much, or no body has such inertias.
        """
        weight = off.mass * self.whole.weight
        empty_weight = self.empty.weight + weight - self.whole.weight
        if not empty_weight > 0.0:
            lowest = 1.0 - self.empty.weight / self.whole.weight
            raise InputError(
                f"`mass_factor` must be above {lowest:.3g}, what load and fuel weigh, "
                f"got {off.mass:g}."
            )
        cg = self.whole.cg + np.array([1.0, 1.0, -1.0]) * off.cg_shift / FT
        inertia = self._inertia(off)
        load_weight = self.whole.weight - self.empty.weight
        if load_weight > _LUMPS * self.whole.weight:
            moment = self.whole.weight * self.whole.cg - self.empty.weight * self.empty.cg
            load_cg = moment / load_weight
            empty_cg = (weight * cg - load_weight * load_cg) / empty_weight
            inertia = inertia - self._load_inertia(load_weight, load_cg, cg)
            inertia = inertia - self._offset(empty_weight, empty_cg - cg)
        else:
            empty_cg = cg
        found = {name: _SIGN[name] * float(inertia[at]) for name, at in _INERTIA.items()}
        found |= dict(zip(("cg_x", "cg_y", "cg_z"), (empty_cg * _INCHES).tolist(), strict=True))
        return found | {"emptywt": empty_weight}

    def _load_inertia(self, weight: float, load_cg: FloatArray, cg: FloatArray) -> FloatArray:
        """Inertia of load and fuel about `cg`."""
        whole, empty = self.whole, self.empty
        about_nominal = whole.inertia - empty.inertia
        about_nominal = about_nominal - self._offset(empty.weight, empty.cg - whole.cg)
        own = about_nominal - self._offset(weight, load_cg - whole.cg)
        return own + self._offset(weight, load_cg - cg)

    def _offset(self, weight: float, distance: FloatArray) -> FloatArray:
        """Inertia of a point at `distance` (ft: aft, right, up), body axes."""
        x = np.array([-1.0, 1.0, -1.0]) * distance
        return weight / self.pounds_per_slug * (x @ x * np.eye(3) - np.outer(x, x))

    def _inertia(self, off: OffNominal) -> FloatArray:
        """Inertia of the whole aircraft; refuses what no body has."""
        scaled = self.whole.inertia.copy()
        for name in OffNominal.INERTIAS:
            i, j = _INERTIA[name]
            scaled[i, j] = scaled[j, i] = getattr(off, name) * self.whole.inertia[i, j]
        changed = [f"`{name}_factor`" for name in OffNominal.INERTIAS if getattr(off, name) != 1.0]
        least, middle, largest = np.linalg.eigvalsh(scaled)
        a, b, c = np.linalg.eigvalsh(self.whole.inertia)
        sum_needed = min(1.0, (a + b) / c)  # some aircraft break the inequality as they are
        possible = least > 0.0 and least + middle >= (sum_needed - _TRIANGLE) * largest
        if changed and not possible:
            got = ", ".join(f"{value * _KG_M2:.4g}" for value in (least, middle, largest))
            raise InputError(
                f"{' and '.join(changed)} must leave principal inertias of which none is larger "
                f"than the two others together, got {got} kg m2."
            )
        return scaled


def weigh(root: Element, nominal: AircraftConfig) -> MassBalance:
    """Return the mass balance of the aircraft with the main file `root`.

    Parameters
    ----------
    root : Element
        Main file of the aircraft.
    nominal : AircraftConfig
        The aircraft as its files say.

    Returns
    -------
    MassBalance

    Raises
    ------
    PlantError
        If JSBSim cannot load it, or its file does not say what the empty aircraft weighs.
    """
    from flighttune.plants.jsbsim.fdm import Fdm

    read = Fdm(nominal, _ANY_RATE_HZ).reader
    weight = read("inertia/weight-lbs")()
    cg = np.array([read(f"inertia/cg-{axis}-in")() for axis in "xyz"]) / _INCHES
    tensor = _tensor({name: read(f"inertia/{name}-slugs_ft2")() for name in _INERTIA})
    whole = _Body(weight, cg, tensor)
    empty_weight = read("inertia/empty-weight-lbs")()
    empty = whole
    if weight - empty_weight > _LUMPS * weight:
        empty = _Body(empty_weight, *_as_written(root, nominal))
    return MassBalance(whole, empty, weight / read("inertia/mass-slugs")())


def open_mass_balance(root: Element) -> None:
    """Put placeholders where the file says what the empty aircraft weighs."""
    (balance,) = root.findall("mass_balance")
    for element in balance.findall("*"):
        if element.tag in (*_INERTIA, "emptywt", "location"):
            balance.remove(element)
    balance.set("negated_crossproduct_inertia", "false")
    for name in _INERTIA:
        SubElement(balance, name, unit="SLUG*FT2").text = placeholder(name)
    SubElement(balance, "emptywt", unit="LBS").text = placeholder("emptywt")
    location = SubElement(balance, "location", name="CG", unit="IN")
    for axis in "xyz":
        SubElement(location, axis).text = placeholder(f"cg_{axis}")


def _as_written(root: Element, nominal: AircraftConfig) -> tuple[FloatArray, FloatArray]:
    """Centre of gravity (ft) and inertia (slug ft^2) of the empty aircraft."""
    try:
        (balance,) = root.findall("mass_balance")
        (location,) = balance.findall("location")
        length = _FEET_IN[location.get("unit", "IN")]
        cg = np.array([float(location.findtext(axis, "0")) for axis in "xyz"]) * length
        plain = balance.get("negated_crossproduct_inertia", "true") == "false"
        found = {name: _inertia_of(balance.find(name)) for name in _INERTIA}
    except (KeyError, ValueError) as error:
        raise PlantError(f"{nominal.file}: its <mass_balance> cannot be read: {error}.") from error
    products = {name for name in found if name[1] != name[2]}
    signed = {
        name: _SIGN[name] * (value if plain or name not in products else -value)
        for name, value in found.items()
    }
    return cg, _tensor(signed)


def _inertia_of(element: Element | None) -> float:
    if element is None:
        return 0.0
    return float(element.text or 0.0) * _SLUG_FT2_IN[element.get("unit", "SLUG*FT2")]


def _tensor(entries: dict[str, float]) -> FloatArray:
    found = np.empty((3, 3))
    for name, (i, j) in _INERTIA.items():
        found[i, j] = found[j, i] = entries[name]
    return found
