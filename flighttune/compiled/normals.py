# SPDX-License-Identifier: LGPL-2.1-or-later
"""The normal numbers of JSBSim on Linux: minstd_rand0 and the polar method of libstdc++, as IR."""

import numpy as np
import numpy.typing as npt

from flighttune.compiled.ir import PREFIX, constant

_MODULUS, _FACTOR = 2147483647, 16807

# A uniform number is made of two draws, of which each has that many values.
_VALUES = float(_MODULUS - 1)
_SQUARED = float((_MODULUS - 1) * (_MODULUS - 1))
_BELOW_ONE = 0.9999999999999999

_DRAW = f"""
define private double @draw(ptr %state) alwaysinline {{
  %x0 = load i64, ptr %state
  %m1 = mul i64 %x0, {_FACTOR}
  %x1 = urem i64 %m1, {_MODULUS}
  %m2 = mul i64 %x1, {_FACTOR}
  %x2 = urem i64 %m2, {_MODULUS}
  store i64 %x2, ptr %state
  %i1 = sub i64 %x1, 1
  %d1 = uitofp i64 %i1 to double
  %i2 = sub i64 %x2, 1
  %d2 = uitofp i64 %i2 to double
  %scaled = fmul double %d2, {constant(_VALUES)}
  %sum = fadd double %d1, %scaled
  %y = fdiv double %sum, {constant(_SQUARED)}
  %over = fcmp oge double %y, 1.0
  %z = select i1 %over, double {constant(_BELOW_ONE)}, double %y
  %twice = fmul double %z, 2.0
  %centred = fsub double %twice, 1.0
  ret double %centred
}}
"""

# Numbers that stand `stride` places apart, as those of an aircraft in its lane of a vector do.
NORMALS = (
    _DRAW
    + f"""
define void @normals(ptr %state, i64 %n, ptr %out) {{
  call void @spread(ptr %state, i64 %n, ptr %out, i64 1)
  ret void
}}

define void @spread(ptr %state, i64 %n, ptr %out, i64 %stride) {{
entry:
  br label %next
next:
  %i = phi i64 [ 0, %entry ], [ %i2, %second ]
  %more = icmp slt i64 %i, %n
  br i1 %more, label %try, label %end
try:
  %a = call double @draw(ptr %state)
  %b = call double @draw(ptr %state)
  %aa = fmul double %a, %a
  %bb = fmul double %b, %b
  %r2 = fadd double %aa, %bb
  %out_of = fcmp ogt double %r2, 1.0
  %zero = fcmp oeq double %r2, 0.0
  %again = or i1 %out_of, %zero
  br i1 %again, label %try, label %store
store:
  %log = call double @{PREFIX}log(double %r2)
  %scaled = fmul double %log, -2.0
  %ratio = fdiv double %scaled, %r2
  %factor = call double @llvm.sqrt.f64(double %ratio)
  %u = fmul double %b, %factor
  %at = mul i64 %i, %stride
  %pu = getelementptr double, ptr %out, i64 %at
  store double %u, ptr %pu
  %i1 = add i64 %i, 1
  %two = icmp slt i64 %i1, %n
  br i1 %two, label %pair, label %second
pair:
  %v = fmul double %a, %factor
  %pv = getelementptr double, ptr %pu, i64 %stride
  store double %v, ptr %pv
  br label %second
second:
  %i2 = add i64 %i, 2
  br label %next
end:
  ret void
}}
"""
)


def seeded(seed: int) -> npt.NDArray[np.int64]:
    """The state of the generator after a seed."""
    return np.array([seed % _MODULUS or 1], dtype=np.int64)
