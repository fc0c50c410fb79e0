# SPDX-License-Identifier: LGPL-2.1-or-later
"""The normal numbers of JSBSim on Linux: minstd_rand0 and the polar method of libstdc++, as IR."""

from functools import partial

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

NORMALS = (
    _DRAW
    + f"""
define void @normals(ptr %state, i64 %n, ptr %out) {{
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
  %pu = getelementptr double, ptr %out, i64 %i
  store double %u, ptr %pu
  %i1 = add i64 %i, 1
  %two = icmp slt i64 %i1, %n
  br i1 %two, label %pair, label %second
pair:
  %v = fmul double %a, %factor
  %pv = getelementptr double, ptr %out, i64 %i1
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

# Numbers of the generators of a vector, which go on together until each has its pair.
_TOGETHER = """
define void @together(ptr %state, i64 %n, ptr %out) {{
entry:
  %any = icmp sgt i64 %n, 0
  br i1 %any, label %first, label %end
first:
  %s0 = load {whole}, ptr %state, align 8
  br label %next
next:
  %s = phi {whole} [ %s0, %first ], [ %sk, %store ]
  %i = phi i64 [ 0, %first ], [ %i2, %store ]
  br label %try
try:
  %x = phi {whole} [ %s, %next ], [ %sk, %try ]
  %done = phi {truth} [ zeroinitializer, %next ], [ %dk, %try ]
  %ap = phi {real} [ zeroinitializer, %next ], [ %ak, %try ]
  %bp = phi {real} [ zeroinitializer, %next ], [ %bk, %try ]
  %rp = phi {real} [ zeroinitializer, %next ], [ %rk, %try ]
{drawn}
  %aa = fmul {real} %a, %a
  %bb = fmul {real} %b, %b
  %r2 = fadd {real} %aa, %bb
  %inside = fcmp ole {real} %r2, {one}
  %moved = fcmp une {real} %r2, zeroinitializer
  %good = and {truth} %inside, %moved
  %sk = select {truth} %done, {whole} %x, {whole} %x4
  %ak = select {truth} %done, {real} %ap, {real} %a
  %bk = select {truth} %done, {real} %bp, {real} %b
  %rk = select {truth} %done, {real} %rp, {real} %r2
  %dk = or {truth} %done, %good
  %all = call i1 @llvm.vector.reduce.and.v{width}i1({truth} %dk)
  br i1 %all, label %store, label %try
store:
{log}
  %scaled = fmul {real} %log, {minus_two}
  %ratio = fdiv {real} %scaled, %rk
  %factor = call {real} @llvm.sqrt.v{width}f64({real} %ratio)
  %u = fmul {real} %bk, %factor
  %v = fmul {real} %ak, %factor
  %pu = getelementptr {real}, ptr %out, i64 %i
  store {real} %u, ptr %pu, align 8
  %i1 = add i64 %i, 1
  %pv = getelementptr {real}, ptr %out, i64 %i1
  store {real} %v, ptr %pv, align 8
  %i2 = add i64 %i, 2
  %more = icmp slt i64 %i2, %n
  br i1 %more, label %next, label %last
last:
  store {whole} %sk, ptr %state, align 8
  br label %end
end:
  ret void
}}
"""


def together(width: int) -> str:
    """IR of ``together(state, n, out)``: ``normals`` of `width` generators side by side, n even."""
    types = {name: f"<{width} x {x}>" for name, x in _TYPES.items()}
    return _TOGETHER.format(
        **types,
        width=width,
        one=_every(width, "double", "1.0"),
        minus_two=_every(width, "double", "-2.0"),
        drawn="\n".join(f"  {line}" for line in _pair(width, **types)),
        log="\n".join(f"  {line}" for line in _logs(width, types["real"])),
    )


_TYPES = {"real": "double", "whole": "i64", "truth": "i1", "half": "i32"}


def _every(width: int, kind: str, x: str) -> str:
    return f"<{', '.join([f'{kind} {x}'] * width)}>"


def _pair(width: int, *, real: str, whole: str, truth: str, half: str) -> list[str]:
    """Lines that draw two uniform numbers, each of two draws, as ``draw`` does."""
    of, lines = {name: partial(_every, width, x) for name, x in _TYPES.items()}, []
    modulus = of["whole"](str(_MODULUS))
    for k in range(1, 5):
        # A remainder by 2^31 - 1 is a sum of the number's parts, less that once.
        before = "%x" if k == 1 else f"%x{k - 1}"
        lines += [
            f"%m{k} = mul {whole} {before}, {of['whole'](str(_FACTOR))}",
            f"%low{k} = and {whole} %m{k}, {modulus}",
            f"%high{k} = lshr {whole} %m{k}, {of['whole']('31')}",
            f"%t{k} = add {whole} %low{k}, %high{k}",
            f"%over{k} = icmp uge {whole} %t{k}, {modulus}",
            f"%less{k} = sub {whole} %t{k}, {modulus}",
            f"%x{k} = select {truth} %over{k}, {whole} %less{k}, {whole} %t{k}",
            f"%i{k}a = sub {whole} %x{k}, {of['whole']('1')}",
            f"%i{k}b = trunc {whole} %i{k}a to {half}",  # below 2^31
            f"%d{k} = sitofp {half} %i{k}b to {real}",
        ]
    values, squared, below = (of["real"](constant(x)) for x in (_VALUES, _SQUARED, _BELOW_ONE))
    for name, k in (("a", 1), ("b", 3)):
        lines += [
            f"%h{name} = fmul {real} %d{k + 1}, {values}",
            f"%f{name} = fadd {real} %d{k}, %h{name}",
            f"%y{name} = fdiv {real} %f{name}, {squared}",
            f"%e{name} = fcmp oge {real} %y{name}, {of['real']('1.0')}",
            f"%z{name} = select {truth} %e{name}, {real} {below}, {real} %y{name}",
            f"%w{name} = fmul {real} %z{name}, {of['real']('2.0')}",
            f"%{name} = fsub {real} %w{name}, {of['real']('1.0')}",
        ]
    return lines


def _logs(width: int, real: str) -> list[str]:
    """Lines that take the C library's logarithm of each lane."""
    lines, before = [], "poison"
    for lane in range(width):
        after = "%log" if lane == width - 1 else f"%log{lane}"
        lines += [
            f"%of{lane} = extractelement {real} %rk, i32 {lane}",
            f"%l{lane} = call double @{PREFIX}log(double %of{lane})",
            f"{after} = insertelement {real} {before}, double %l{lane}, i32 {lane}",
        ]
        before = after
    return lines


def seeded(seed: int) -> npt.NDArray[np.int64]:
    """The state of the generator after a seed."""
    return np.array([seed % _MODULUS or 1], dtype=np.int64)
