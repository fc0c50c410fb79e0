# SPDX-License-Identifier: LGPL-2.1-or-later
"""Vectors, matrices and quaternions of symbolic doubles, in JSBSim's order of operations."""

import math
from collections.abc import Sequence
from typing import TypeAlias

from flighttune.compiled.trace import (
    Number,
    Truth,
    asin,
    atan2,
    cos,
    equal,
    fabs,
    negated,
    select,
    sin,
    sqrt,
)

Vector: TypeAlias = Sequence[Number]
Matrix: TypeAlias = Sequence[Vector]

# Distance of the norm of a quaternion from 1 below which it is left as it is.
_NORMAL = 1e-10

ZERO: Vector = (0.0, 0.0, 0.0)


def add(a: Vector, b: Vector) -> Vector:
    """Sum."""
    return [x + y for x, y in zip(a, b, strict=True)]


def sub(a: Vector, b: Vector) -> Vector:
    """Difference."""
    return [x - y for x, y in zip(a, b, strict=True)]


def scale(factor: Number, a: Vector) -> Vector:
    """Product with a number."""
    return [factor * x for x in a]


def over(a: Vector, divisor: Number) -> Vector:
    """Quotient by a number: the product with its inverse."""
    return scale(1.0 / divisor, a)


def cross(a: Vector, b: Vector) -> Vector:
    """Cross product."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def magnitude(a: Vector) -> Number:
    """Length."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def times(m: Matrix, v: Vector) -> Vector:
    """Product of a matrix and a vector."""
    return [v[0] * row[0] + v[1] * row[1] + v[2] * row[2] for row in m]


def product(a: Matrix, b: Matrix) -> Matrix:
    """Product of two matrices."""
    return [[row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j] for j in range(3)] for row in a]


def transposed(m: Matrix) -> Matrix:
    """Transpose."""
    return [list(column) for column in zip(*m, strict=True)]


def inverse(m: Matrix) -> Matrix:
    """Inverse by Cramer's rule."""
    (a, b, c), (d, e, f), (g, h, i) = m
    determinant = a * e * i + b * f * g + c * d * h - c * e * g - b * d * i - f * h * a
    r = 1.0 / determinant
    return [
        [r * (e * i - f * h), r * (c * h - b * i), r * (b * f - c * e)],
        [r * (f * g - d * i), r * (a * i - c * g), r * (c * d - a * f)],
        [r * (d * h - e * g), r * (b * g - a * h), r * (a * e - b * d)],
    ]


def normalized(q: Vector) -> Vector:
    """A quaternion of length 1."""
    length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    inverse = 1.0 / length
    keep = equal(length, 0.0) | (fabs(length - 1.0) < _NORMAL)
    return [select(keep, x, x * inverse) for x in q]


def quaternion_by(phi: Number, theta: Number, psi: Number) -> Vector:
    """The quaternion of roll, pitch attitude and heading (rad)."""
    sines, cosines = ([of(0.5 * x) for x in (phi, theta, psi)] for of in (sin, cos))
    (s_phi, s_theta, s_psi), (c_phi, c_theta, c_psi) = sines, cosines
    cc, cs, ss, sc = c_phi * c_theta, c_phi * s_theta, s_phi * s_theta, s_phi * c_theta
    q = cc * c_psi + ss * s_psi, sc * c_psi - cs * s_psi
    return normalized((*q, cs * c_psi + sc * s_psi, cc * s_psi - ss * c_psi))


def quaternion_product(a: Vector, b: Vector) -> Vector:
    """The rotation `a`, then `b`."""
    return [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]


def matrix_of(q: Vector) -> Matrix:
    """The rotation of a quaternion."""
    a, b, c, d = q
    aa, bb, cc, dd = a * a, b * b, c * c, d * d
    ab, ac, ad, bc, bd, cd = a * b, a * c, a * d, b * c, b * d, c * d
    return [
        [aa + bb - cc - dd, 2.0 * (bc + ad), 2.0 * (bd - ac)],
        [2.0 * (bc - ad), aa - bb + cc - dd, 2.0 * (cd + ab)],
        [2.0 * (bd + ac), 2.0 * (cd - ab), aa - bb - cc + dd],
    ]


def quaternion_of(m: Matrix) -> Vector:
    """The quaternion of a rotation, from the largest of its components."""
    (m11, m12, m13), (m21, m22, m23), (m31, m32, m33) = m
    sums = (
        1.0 + m11 + m22 + m33,
        1.0 + m11 - m22 - m33,
        1.0 - m11 + m22 - m33,
        1.0 - m11 - m22 + m33,
    )
    best: Number = sums[0]
    chosen: list[Truth] = [True, False, False, False]
    for i in (1, 2, 3):
        more = sums[i] > best
        best = select(more, sums[i], best)
        chosen = [*(was & negated(more) for was in chosen[:i]), more, *chosen[i + 1 :]]
    r = 0.50 * sqrt(best)
    a, b, c, d, e, f = m23 - m32, m31 - m13, m12 - m21, m12 + m21, m31 + m13, m23 + m32
    rows = ((0.0, a, b, c), (a, 0.0, d, e), (b, d, 0.0, f), (c, e, f, 0.0))
    q = []
    for n in range(4):
        first, second, third = (k for k in range(4) if k != n)
        x = rows[third][n]
        for k in (second, first):
            x = select(chosen[k], rows[k][n], x)
        q.append(select(chosen[n], r, 0.25 * x / r))
    return q


def euler_angles(m: Matrix) -> tuple[Number, Number, Number]:
    """Roll, pitch attitude and heading (rad) of a rotation, the heading in 0 to 2 pi."""
    up, down = m[0][2] <= -1.0, m[0][2] >= 1.0
    lock = up | down
    theta = select(up, 0.5 * math.pi, select(down, -0.5 * math.pi, asin(-m[0][2])))
    phi = atan2(select(lock, -m[2][1], m[1][2]), select(lock, m[1][1], m[2][2]))
    psi = atan2(m[0][1], m[0][0])
    return phi, theta, select(lock, 0.0, select(psi < 0.0, psi + 2 * math.pi, psi))
