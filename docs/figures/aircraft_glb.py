"""The aircraft that recordings show: twin booms and an inverted V-tail, of lofted sections.

Run it with ``python docs/figures/aircraft_glb.py``: it writes
``flighttune/outputs/recording/aircraft.glb``.
"""

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.outputs.recording.scene import MODEL_SPAN

MODEL = Path(__file__).parents[2] / "flighttune/outputs/recording/aircraft.glb"
SHADES = {True: 1.0, False: 0.45}
"""Brightness of wing and tail, and of the rest; the colour of the run multiplies both."""

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
FLOAT32, UINT32, TRIANGLES = 5126, 5125, 4
SEGMENTS = 16
AEROFOIL = np.array(
    [
        (0.0, 0.0),
        (0.1, 0.065),
        (0.35, 0.085),
        (1.0, 0.004),
        (1.0, -0.004),
        (0.35, -0.04),
        (0.1, -0.04),
    ]
)
"""Outline of a wing section: fraction of the chord from the nose, height over the chord."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles in body axes: x forward, y right, z down, m; origin at the quarter chord.

    Attributes
    ----------
    vertices, normals : ndarray, shape (n, 3), m and 1
        Corners and the outward unit normal at each.
    triangles : ndarray of int, shape (k, 3)
        Corners of each triangle.
    accent : ndarray of bool, shape (n,)
        True on wing and tail, which carry the colour of the run.
    """

    vertices: FloatArray
    normals: FloatArray
    triangles: np.ndarray
    accent: np.ndarray


def write_glb(mesh: Mesh, path: Path) -> None:
    """Write a mesh as glTF 2.0: a primitive and a material for each of the two shades."""
    accessors, views, primitives, materials, binary = [], [], [], [], b""

    def added(values: np.ndarray, component: int, kind: str) -> int:
        nonlocal binary
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        ends = {"min": values.min(axis=0), "max": values.max(axis=0)}
        accessors.append(
            {
                "bufferView": len(views) - 1,
                "componentType": component,
                "count": len(values),
                "type": kind,
                **{name: np.atleast_1d(end).tolist() for name, end in ends.items()},
            }
        )
        binary += values.tobytes()
        return len(accessors) - 1

    corners = mesh.triangles.ravel()
    for accent, shade in SHADES.items():
        here = corners[mesh.accent[corners] == accent]
        primitives.append(
            {
                "attributes": {
                    "POSITION": added(mesh.vertices[here].astype("<f4"), FLOAT32, "VEC3"),
                    "NORMAL": added(mesh.normals[here].astype("<f4"), FLOAT32, "VEC3"),
                },
                # Rerun draws no primitive without indices.
                "indices": added(np.arange(len(here), dtype="<u4"), UINT32, "SCALAR"),
                "material": len(materials),
                "mode": TRIANGLES,
            }
        )
        materials.append({"pbrMetallicRoughness": {"baseColorFactor": [shade] * 3 + [1.0]}})
    document = {
        "asset": {"version": "2.0", "generator": "flighttune"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = b"".join(
        struct.pack("<II", len(data), kind) + data
        for data, kind in ((text, JSON_CHUNK), (binary, BINARY_CHUNK))
    )
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def aircraft_mesh() -> Mesh:
    """Return the aircraft, `MODEL_SPAN` wide and in true proportion."""
    parts = [
        (_pod(), False),
        *((_wing(side), True) for side in (-1.0, 1.0)),
        *((_boom(side), False) for side in (-1.0, 1.0)),
        *((_tail(side), True) for side in (-1.0, 1.0)),
        (_propeller(), False),
    ]
    return _joined([(*_loft(sections), accent) for sections, accent in parts])


def _pod() -> FloatArray:
    stations = [
        (0.62, 0.004, 0.06),
        (0.57, 0.05, 0.06),
        (0.45, 0.085, 0.05),
        (0.20, 0.11, 0.03),
        (-0.10, 0.11, 0.02),
        (-0.35, 0.09, 0.01),
        (-0.47, 0.05, 0.0),
        (-0.50, 0.004, 0.0),
    ]
    return np.array([_ring(x, radius, 0.0, down) for x, radius, down in stations])


def _boom(side: float) -> FloatArray:
    stations = [(0.10, 0.004), (0.07, 0.022), (-1.10, 0.016), (-1.13, 0.003)]
    return np.array([_ring(x, radius, side * 0.27, -0.05) for x, radius in stations])


def _propeller() -> FloatArray:
    return np.array([_ring(x, radius, 0.0, 0.0) for x, radius in ((-0.50, 0.03), (-0.58, 0.004))])


def _wing(side: float) -> FloatArray:
    half = MODEL_SPAN / 2.0
    return np.array(
        [
            _section(0.10, 0.30, (0.0, -0.10)),
            _section(0.10, 0.30, (side * 0.45 * half, -0.115)),
            _section(0.06, 0.20, (side * 0.97 * half, -0.16)),
            _section(0.01, 0.12, (side * half, -0.165)),
        ]
    )


def _tail(side: float) -> FloatArray:
    return np.array(
        [_section(-0.95, 0.20, (side * 0.27, -0.05)), _section(-0.99, 0.16, (0.0, -0.34))]
    )


def _ring(x: float, radius: float, right: float, down: float) -> FloatArray:
    angle = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    around = np.column_stack([np.cos(angle), np.sin(angle)]) * radius
    return np.column_stack([np.full(SEGMENTS, x), around + np.array([right, down])])


def _section(nose: float, chord: float, where: tuple[float, float]) -> FloatArray:
    back, up = AEROFOIL.T * chord
    right, down = where
    return np.column_stack([nose - back, np.full(len(back), right), down - up])


def _loft(sections: FloatArray) -> tuple[FloatArray, np.ndarray]:
    """Skin of closed `sections`, shape (s, k, 3), with flat ends."""
    count, around, _ = sections.shape
    start = np.arange(count - 1)[:, None] * around
    here = np.arange(around)[None, :]
    after = (here + 1) % around
    a, b = start + here, start + after
    sides = np.stack([a, b, b + around, a, b + around, a + around], axis=-1).reshape(-1, 3)
    fan = np.column_stack(
        [np.zeros(around - 2, int), np.arange(1, around - 1), np.arange(2, around)]
    )
    ends = np.vstack([fan[:, ::-1], fan + (count - 1) * around])
    return sections.reshape(-1, 3), np.vstack([sides, ends])


def _joined(parts: list[tuple[FloatArray, np.ndarray, bool]]) -> Mesh:
    corners, normals, accents = [], [], []
    for vertices, triangles, accent in parts:
        faces = vertices[triangles]
        outward = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        if np.sum(outward * (faces.mean(axis=1) - vertices.mean(axis=0))) < 0.0:
            faces, outward = faces[:, ::-1], -outward
        size = np.linalg.norm(outward, axis=1)
        faces, outward = faces[size > 0.0], outward[size > 0.0] / size[size > 0.0, None]
        corners.append(faces.reshape(-1, 3))
        normals.append(np.repeat(outward, 3, axis=0))
        accents.append(np.full(3 * len(faces), accent))
    vertices = np.vstack(corners)
    return Mesh(
        vertices=vertices,
        normals=np.vstack(normals),
        triangles=np.arange(len(vertices)).reshape(-1, 3),
        accent=np.concatenate(accents),
    )


if __name__ == "__main__":
    write_glb(aircraft_mesh(), MODEL)
