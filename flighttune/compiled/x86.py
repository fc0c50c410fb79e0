# SPDX-License-Identifier: LGPL-2.1-or-later
"""What a function of the C library computes, read from its own machine code on x86-64.

A walk follows the code of a function for numbers that are known, or for the numbers of the lanes of
a vector, of which it writes the operations down as IR. What it does not know ends it: the caller
then calls the function itself.
"""

import ctypes
import math
import re
import struct
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

# Longest walk, in instructions.
_LONGEST = 2000

_ALL = (1 << 64) - 1

# Flags that a comparison of doubles sets, by condition: its relation in IR
_REAL = {"a": "ogt", "ae": "oge", "b": "ult", "be": "ule", "e": "ueq", "ne": "one"}
_REAL |= {"p": "uno", "np": "ord"}
_WHOLE = {"e": "eq", "ne": "ne", "a": "ugt", "ae": "uge", "b": "ult", "be": "ule", "g": "sgt"}
_WHOLE |= {"ge": "sge", "l": "slt", "le": "sle", "s": "slt", "ns": "sge"}
_COMPARED = {"lt": "olt", "le": "ole", "nlt": "uge", "nle": "ugt", "eq": "oeq", "neq": "une"}
_COMPARED |= {"gt": "ogt", "ge": "oge"}
_ARITHMETIC = {"addsd": "fadd", "subsd": "fsub", "mulsd": "fmul", "divsd": "fdiv"}
_MOVES = {"mov", "movq", "movd", "movsd", "movapd", "movaps", "movabs", "movups", "movupd"}
_BITS = {"xorpd": "xor", "xorps": "xor", "pxor": "xor", "andpd": "and", "andps": "and"}
_BITS |= {"pand": "and", "orpd": "or", "orps": "or", "andnpd": "and", "andnps": "and"}


class UnknownCodeError(Exception):
    """An instruction, or a use of one, that a walk does not know."""


class Known(NamedTuple):
    """64 bits that are known."""

    bits: int


class Vector(NamedTuple):
    """A number of each lane: the name of a value of IR, of doubles or of whole numbers."""

    name: str
    real: bool


class Stack(NamedTuple):
    """An address of the stack."""

    offset: int


class Flags(NamedTuple):
    """What two values that were compared last are: doubles, or whole numbers of a width."""

    a: Any
    b: Any
    bits: int  # 0 of doubles


def real_of(bits: int) -> float:
    """The double of 64 bits."""
    return struct.unpack("<d", struct.pack("<Q", bits & _ALL))[0]


def known(x: float) -> Known:
    """A double that is known."""
    return Known(struct.unpack("<Q", struct.pack("<d", x))[0])


@cache
def _decoder() -> Any:
    import capstone

    decoder = capstone.Cs(capstone.CS_ARCH_X86, capstone.CS_MODE_64)
    decoder.detail = True
    return decoder


@cache
def _instruction(address: int) -> Any:
    """The instruction at an address of this process."""
    code = ctypes.string_at(address, 15)
    found = next(_decoder().disasm(code, address, 1), None)
    if found is None:
        raise UnknownCodeError(f"at {address:#x}")
    return found


class Walk:
    """One way through a function: its result, and which way each jump went.

    `decisions` say which way jumps go that depend on numbers of lanes; each is then a guard, which
    holds in the lanes that go this way. Without lanes all numbers are known, and decide. `library`
    is where the code and its tables are, outside of which nothing is read; another process has them
    elsewhere.
    """

    def __init__(
        self, width: int, library: range, prefix: str = "", decisions: Sequence[bool] = ()
    ) -> None:
        self.width, self._prefix, self._count, self._library = width, prefix, 0, library
        self.lines: list[str] = []
        self.taken: list[bool] = []
        self._decisions, self.guard = iter(decisions), ""
        self._registers: dict[str, Any] = {"rsp": Stack(0)}
        self._stack: dict[int, Any] = {}
        self._flags = Flags(Known(0), Known(0), 64)

    # Values of lanes

    def of(self, kind: str) -> str:
        """The type of a value of each lane."""
        return f"<{self.width} x {kind}>"

    def every(self, kind: str, text: str | int) -> str:
        """A constant in every lane."""
        return f"<{', '.join([f'{kind} {text}'] * self.width)}>"

    def emit(self, text: str) -> str:
        """Write an operation down; the name of its value."""
        self._count += 1
        name = f"%{self._prefix}{self._count}"
        self.lines.append(f"{name} = {text}")
        return name

    def whole(self, value: Any) -> str:
        """A value as whole numbers of lanes."""
        if isinstance(value, Known):
            if value.bits in self._library:
                return self._of_library(value.bits - self._library.start)
            return self.every("i64", value.bits - (value.bits >> 63 << 64))
        if isinstance(value, Stack):
            raise UnknownCodeError("an address of the stack as a number")
        if value.real:
            return self.emit(f"bitcast {self.of('double')} {value.name} to {self.of('i64')}")
        return value.name

    def _of_library(self, offset: int) -> str:
        """An address in the library of the process that flies."""
        start = self.emit("load i64, ptr @flighttune_library")
        place = self.emit(f"add i64 {start}, {offset}")
        one = self.emit(f"insertelement {self.of('i64')} poison, i64 {place}, i32 0")
        zeros = f"<{self.width} x i32> zeroinitializer"
        return self.emit(f"shufflevector {self.of('i64')} {one}, {self.of('i64')} poison, {zeros}")

    def real(self, value: Any) -> str:
        """A value as doubles of lanes."""
        if isinstance(value, Known):
            return self.every("double", f"0x{value.bits:016X}")
        if isinstance(value, Stack):
            raise UnknownCodeError("an address of the stack as a number")
        if value.real:
            return value.name
        return self.emit(f"bitcast {self.of('i64')} {value.name} to {self.of('double')}")

    def _reals(self, text: str, fold: Callable[..., float], *values: Any) -> Any:
        """An operation on doubles, by `fold` where all are known; `text` with a place for each."""
        if all(isinstance(value, Known) for value in values):
            try:
                return known(fold(*(real_of(value.bits) for value in values)))
            except (ArithmeticError, ValueError):
                return known(math.nan)
        return Vector(
            self.emit(text.format(*map(self.real, values), t=self.of("double"))), real=True
        )

    def _wholes(self, op: str, a: Any, b: Any, bits: int = 64) -> Any:
        """An operation on whole numbers of some bits."""
        if isinstance(a, Stack) or isinstance(b, Stack):
            return self._of_stack(op, a, b)
        if isinstance(a, Known) and isinstance(b, Known):
            return Known(_FOLDED[op](a.bits, b.bits) & ((1 << bits) - 1))
        if b == Known(0) and op in ("add", "sub", "or", "xor", "shl", "lshr"):
            return a
        text = f"{op} {self.of('i64')} {self.whole(a)}, {self.whole(b)}"
        return self._masked(Vector(self.emit(text), real=False), bits)

    @staticmethod
    def _of_stack(op: str, a: Any, b: Any) -> Any:
        if isinstance(b, Stack) and op == "add":
            a, b = b, a
        if isinstance(a, Stack) and isinstance(b, Known) and op in ("add", "sub", "and"):
            by = b.bits - (b.bits >> 63 << 64)
            return a if op == "and" else Stack(a.offset + (by if op == "add" else -by))
        raise UnknownCodeError("arithmetic with an address of the stack")

    def _masked(self, value: Any, bits: int) -> Any:
        if bits == 64 or isinstance(value, Stack):
            return value
        mask = (1 << bits) - 1
        if isinstance(value, Known):
            return Known(value.bits & mask)
        text = f"and {self.of('i64')} {self.whole(value)}, {self.every('i64', mask)}"
        return Vector(self.emit(text), real=False)

    def _signed(self, value: Any, bits: int) -> Any:
        """A number of some bits with its sign in all 64."""
        if isinstance(value, Known):
            low = value.bits & ((1 << bits) - 1)
            return Known((low - (low >> (bits - 1) << bits)) & _ALL)
        by = Known(64 - bits)
        return self._wholes("ashr", self._wholes("shl", value, by), by) if bits < 64 else value

    def _holds(self, condition: str) -> bool | str:
        """Whether a condition of the flags holds: where it is known, or the name of its value."""
        a, b, bits = self._flags
        if not bits:
            if isinstance(a, Known) and isinstance(b, Known):
                return _compared(_REAL[condition], real_of(a.bits), real_of(b.bits))
            return self._compare(_REAL[condition], a, b)
        if bits < 64:  # the sign of a number of fewer bits is at their end
            a, b = (self._wholes("shl", x, Known(64 - bits)) for x in (a, b))
        relation = _WHOLE[condition]
        if isinstance(a, Known) and isinstance(b, Known):
            sides = (a.bits, b.bits)
            if relation.startswith("s"):
                sides = tuple(x - (x >> 63 << 64) for x in sides)
            return _compared(relation.lstrip("su") if len(relation) > 2 else relation, *sides)
        return self.emit(f"icmp {relation} {self.of('i64')} {self.whole(a)}, {self.whole(b)}")

    def _compare(self, relation: str, a: Any, b: Any) -> str:
        return self.emit(f"fcmp {relation} {self.of('double')} {self.real(a)}, {self.real(b)}")

    # Operands

    def _read(self, operand: Any, instruction: Any, bits: int = 0) -> Any:
        bits = bits or min(64, 8 * operand.size)
        if operand.type == 2:  # immediate
            return Known(operand.imm & ((1 << bits) - 1))
        if operand.type == 3:
            return self._load(operand.mem, instruction, bits)
        name = instruction.reg_name(operand.reg)
        full, low, size = _register(name)
        value = self._registers.get(full, Known(0))
        if low:
            value = self._wholes("lshr", value, Known(8))
        return self._masked(value, size) if size < 64 else value

    def _write(self, operand: Any, instruction: Any, value: Any) -> None:
        if operand.type == 3:
            place = self._address(operand.mem, instruction)
            if not isinstance(place, Stack):
                raise UnknownCodeError("a write to memory")
            self._stack[place.offset] = value
            return
        full, low, size = _register(instruction.reg_name(operand.reg))
        if size in (8, 16):
            shift, mask = 8 * low, ((1 << size) - 1) << (8 * low)
            part = self._wholes("shl", self._masked(value, size), Known(shift))
            kept = self._wholes("and", self._registers.get(full, Known(0)), Known(_ALL ^ mask))
            value = self._wholes("or", kept, part)
        self._registers[full] = self._masked(value, 32) if size == 32 else value

    def _address(self, memory: Any, instruction: Any) -> Any:
        name = instruction.reg_name
        place: Any = Known(memory.disp & _ALL)
        if memory.base and name(memory.base) == "rip":
            return Known((memory.disp + instruction.address + instruction.size) & _ALL)
        if memory.base:
            place = self._wholes(
                "add", self._registers.get(_register(name(memory.base))[0], Known(0)), place
            )
        if memory.index:
            index = self._registers.get(_register(name(memory.index))[0], Known(0))
            scaled = self._wholes("shl", index, Known(memory.scale.bit_length() - 1))
            place = self._wholes("add", scaled, place)
        return place

    def _load(self, memory: Any, instruction: Any, bits: int) -> Any:
        if memory.segment and instruction.reg_name(memory.segment) == "fs":
            return Known(0)  # the guard of the stack, which is compared with itself
        place = self._address(memory, instruction)
        if isinstance(place, Stack):
            return self._stack.get(place.offset, Known(0))
        if isinstance(place, Known):
            if place.bits not in self._library:
                raise UnknownCodeError("memory outside of the library")
            return Known(int.from_bytes(ctypes.string_at(place.bits, bits // 8), "little"))
        kind, lanes = f"i{bits}", self.width
        at = self.emit(f"inttoptr {self.of('i64')} {self.whole(place)} to {self.of('ptr')}")
        mask = self.guard or self.every("i1", "true")
        called = f"@llvm.masked.gather.v{lanes}{kind}.v{lanes}p0"
        given = (
            f"{self.of('ptr')} {at}, i32 4, {self.of('i1')} {mask}, {self.of(kind)} zeroinitializer"
        )
        value = self.emit(f"call {self.of(kind)} {called}({given})")
        if bits < 64:
            value = self.emit(f"zext {self.of(kind)} {value} to {self.of('i64')}")
        return Vector(value, real=False)

    # Steps

    def result(self, address: int, arguments: Sequence[Any]) -> Any:
        """The value that a function at an address returns for its arguments."""
        for i, value in enumerate(arguments):
            self._registers[f"xmm{i}"] = value
        depth, at = 0, address
        for _ in range(_LONGEST):
            if at not in self._library:
                raise UnknownCodeError("code outside of the library")
            instruction = _instruction(at)
            mnemonic, operands = instruction.mnemonic, instruction.operands
            at += instruction.size
            if mnemonic == "ret":
                if not depth:
                    return self._registers["xmm0"]
                depth, at = depth - 1, self._pop().bits
            elif mnemonic in ("call", "jmp"):
                target = self._read(operands[0], instruction, 64)
                if not isinstance(target, Known):
                    raise UnknownCodeError("a jump by numbers of lanes")
                if mnemonic == "call":
                    depth += 1
                    self._push(Known(at))
                at = target.bits
            elif mnemonic.startswith("j"):
                if self._goes(mnemonic[1:]):
                    at = operands[0].imm
            else:
                self._step(instruction, mnemonic, operands)
        raise UnknownCodeError("a long way")

    def _goes(self, condition: str) -> bool:
        """Whether a jump is taken; the lanes that go another way are left to others."""
        holds = self._holds(condition)
        decided = next(self._decisions, None)
        if isinstance(holds, bool):
            if decided not in (None, holds):
                raise UnknownCodeError("a jump that goes another way")
            self.taken.append(holds)
            return holds
        if decided is None:
            raise UnknownCodeError("a jump that nothing decides")
        self.taken.append(decided)
        if not decided:
            holds = self.emit(f"xor {self.of('i1')} {holds}, {self.every('i1', 'true')}")
        guard = f"and {self.of('i1')} {self.guard}, {holds}"
        self.guard = self.emit(guard) if self.guard else holds
        return decided

    def _push(self, value: Any) -> None:
        top = Stack(self._registers["rsp"].offset - 8)
        self._registers["rsp"], self._stack[top.offset] = top, value

    def _pop(self) -> Any:
        top = self._registers["rsp"]
        self._registers["rsp"] = Stack(top.offset + 8)
        return self._stack[top.offset]

    def _step(self, instruction: Any, mnemonic: str, operands: Sequence[Any]) -> None:
        plain = mnemonic.removeprefix("v")
        if plain in ("endbr64", "nop", "zeroupper", "ldmxcsr"):
            return
        if plain == "cdqe":
            self._registers["rax"] = self._signed(self._registers["rax"], 32)
            return
        for does in (self._moved, self._asked, self._counted, self._floated):
            if operands and does(instruction, plain, operands):
                return
        raise UnknownCodeError(f"{mnemonic} {instruction.op_str}")

    def _moved(self, instruction: Any, name: str, operands: Sequence[Any]) -> bool:
        """Moves."""
        first, last = operands[0], operands[-1]
        if name == "push":
            self._push(self._read(first, instruction, 64))
        elif name == "pop":
            self._write(first, instruction, self._pop())
        elif name == "stmxcsr":
            self._write(first, instruction, Known(0x1F80))
        elif name in _MOVES:
            bits = 64 if "xmm" in instruction.op_str and name != "movd" else 0
            self._write(first, instruction, self._read(last, instruction, bits))
        elif name in ("movsxd", "movsx"):
            value = self._signed(self._read(last, instruction), 8 * last.size)
            self._write(first, instruction, value)
        elif name == "movzx":
            self._write(first, instruction, self._read(last, instruction))
        elif name == "lea":
            self._write(first, instruction, self._address(last.mem, instruction))
        else:
            return False
        return True

    def _asked(self, instruction: Any, name: str, operands: Sequence[Any]) -> bool:
        """Comparisons, and what takes their flags."""
        bits = 8 * operands[0].size
        if name in ("ucomisd", "comisd"):
            a, b = (self._read(x, instruction, 64) for x in operands)
            self._flags = Flags(a, b, 0)
        elif name in ("cmp", "test"):
            a, b = (self._read(x, instruction, bits) for x in operands)
            a, b = (self._wholes("and", a, b), Known(0)) if name == "test" else (a, b)
            self._flags = Flags(a, b, bits)
        elif name.startswith(("set", "cmov")):
            self._chosen(instruction, name, operands)
        else:
            return False
        return True

    def _chosen(self, instruction: Any, name: str, operands: Sequence[Any]) -> None:
        holds = self._holds(re.sub("^(set|cmov)", "", name))
        before = self._read(operands[0], instruction)
        new, old = (
            (Known(1), Known(0))
            if name[0] == "s"
            else (self._read(operands[1], instruction), before)
        )
        if isinstance(holds, bool):
            value = new if holds else old
        else:
            sides = f"{self.of('i64')} {self.whole(new)}, {self.of('i64')} {self.whole(old)}"
            value = Vector(self.emit(f"select {self.of('i1')} {holds}, {sides}"), real=False)
        self._write(operands[0], instruction, value)

    def _counted(self, instruction: Any, name: str, operands: Sequence[Any]) -> bool:
        """Arithmetic of whole numbers."""
        if name not in _INTEGERS:
            return False
        first = operands[0]
        bits = 8 * first.size
        a = self._read(first, instruction)
        if name in ("neg", "not", "inc", "dec"):
            of = {"neg": ("sub", Known(0), a), "not": ("xor", a, Known((1 << bits) - 1))}
            of |= {"inc": ("add", a, Known(1)), "dec": ("sub", a, Known(1))}
            op, a, b = of[name]
            value = self._wholes(op, a, b, bits)
        elif name in ("shl", "shr", "sar", "sal"):
            by = self._read(operands[1], instruction) if len(operands) > 1 else Known(1)
            a = self._signed(a, bits) if name == "sar" else a
            op = {"shr": "lshr", "sar": "ashr"}.get(name, "shl")
            value = self._wholes(op, a, by, bits)
        elif len(operands) == 3:  # imul by a number
            a, b = (self._read(x, instruction) for x in operands[1:])
            value = self._wholes("mul", a, b, bits)
        else:
            b = self._read(operands[1], instruction, bits)
            same = first.type == operands[1].type == 1 and first.reg == operands[1].reg
            zero = same and name in ("xor", "sub")
            value = Known(0) if zero else self._wholes(_INTEGERS[name], a, b, bits)
            if name == "sub" and not isinstance(value, Stack):
                self._flags = Flags(a, b, bits)
                self._write(first, instruction, value)
                return True
        if not isinstance(value, Stack) and name != "not":
            self._flags = Flags(value, Known(0), bits)
        self._write(first, instruction, value)
        return True

    def _floated(self, instruction: Any, name: str, operands: Sequence[Any]) -> bool:
        """Arithmetic of doubles, and of their bits."""
        first, last = operands[0], operands[-1]
        before = operands[-2] if len(operands) > 2 else first

        def read(operand: Any) -> Any:
            return self._read(operand, instruction, 64)

        if name in _ARITHMETIC:
            op = _ARITHMETIC[name]
            value = self._reals(f"{op} {{t}} {{0}}, {{1}}", _FOLDED[op], read(before), read(last))
        elif name == "sqrtsd":
            value = self._reals(
                f"call {{t}} @llvm.sqrt.v{self.width}f64({{t}} {{0}})", math.sqrt, read(last)
            )
        elif fused := re.fullmatch(r"f(n?)m(add|sub)(132|213|231)sd", name):
            value = self._fused(fused, [read(x) for x in operands])
        elif name in _BITS:
            a, b = read(before), read(last)
            a = self._wholes("xor", a, Known(_ALL)) if "andn" in name else a
            same = before.type == last.type == 1 and before.reg == last.reg and "xor" in _BITS[name]
            value = Known(0) if same else self._wholes(_BITS[name], a, b)
        elif compared := re.fullmatch(r"cmp(n?l[te]|n?eq|g[te])sd", name):
            value = self._mask(_COMPARED[compared[1]], read(before), read(last))
        elif name == "blendvpd":
            mask, a, b = read(operands[3]), read(operands[1]), read(operands[2])
            value = self._blended(mask, a, b)
        elif name == "cvttsd2si":
            value = self._truncated(read(last), 8 * first.size)
        elif name == "cvtsi2sd":
            value = self._converted(self._read(last, instruction), 8 * last.size)
        else:
            return False
        self._write(first, instruction, value)
        return True

    def _fused(self, form: re.Match[str], values: Sequence[Any]) -> Any:
        """A product and a sum in one rounding."""
        a, b, c = values
        x, y, z = {"132": (a, c, b), "213": (b, a, c), "231": (b, c, a)}[form[3]]
        minus = Known(1 << 63)
        x = self._wholes("xor", x, minus) if form[1] else x
        z = self._wholes("xor", z, minus) if form[2] == "sub" else z
        text = f"call {{t}} @llvm.fma.v{self.width}f64({{t}} {{0}}, {{t}} {{1}}, {{t}} {{2}})"
        # Its rounding decides no way: a number that is known only finds one.
        return self._reals(text, lambda x, y, z: x * y + z, x, y, z)

    def _mask(self, relation: str, a: Any, b: Any) -> Any:
        if isinstance(a, Known) and isinstance(b, Known):
            return Known(_ALL * _compared(relation, real_of(a.bits), real_of(b.bits)))
        holds = self._compare(relation, a, b)
        return Vector(self.emit(f"sext {self.of('i1')} {holds} to {self.of('i64')}"), real=False)

    def _blended(self, mask: Any, a: Any, b: Any) -> Any:
        if isinstance(mask, Known):
            return b if mask.bits >> 63 else a
        zero = self.every("i64", 0)
        chosen = self.emit(f"icmp slt {self.of('i64')} {self.whole(mask)}, {zero}")
        sides = f"{self.of('double')} {self.real(b)}, {self.of('double')} {self.real(a)}"
        return Vector(self.emit(f"select {self.of('i1')} {chosen}, {sides}"), real=True)

    def _truncated(self, value: Any, bits: int) -> Any:
        if isinstance(value, Known):
            x = real_of(value.bits)
            inside = math.isfinite(x) and abs(x) < 2.0 ** (bits - 1)
            return Known((int(x) if inside else 1 << (bits - 1)) & ((1 << bits) - 1))
        number = self.emit(
            f"fptosi {self.of('double')} {self.real(value)} to {self.of(f'i{bits}')}"
        )
        if bits < 64:
            number = self.emit(f"zext {self.of(f'i{bits}')} {number} to {self.of('i64')}")
        return Vector(number, real=False)

    def _converted(self, value: Any, bits: int) -> Any:
        if isinstance(value, Known):
            number = self._signed(value, bits).bits
            return known(float(number - (number >> 63 << 64)))
        text = self.whole(value)
        if bits < 64:
            text = self.emit(f"trunc {self.of('i64')} {text} to {self.of(f'i{bits}')}")
        number = self.emit(f"sitofp {self.of(f'i{bits}')} {text} to {self.of('double')}")
        return Vector(number, real=True)


_FOLDED: dict[str, Callable[[Any, Any], Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "and": lambda a, b: a & b,
    "or": lambda a, b: a | b,
    "xor": lambda a, b: a ^ b,
    "shl": lambda a, b: a << (b & 63),
    "lshr": lambda a, b: a >> (b & 63),
    "ashr": lambda a, b: (a - (a >> 63 << 64)) >> (b & 63),
    "fadd": lambda a, b: a + b,
    "fsub": lambda a, b: a - b,
    "fmul": lambda a, b: a * b,
    "fdiv": lambda a, b: a / b,
}
_INTEGERS = {x: x for x in ("add", "sub", "and", "or", "xor")} | {"imul": "mul"}
_INTEGERS |= dict.fromkeys(("neg", "not", "inc", "dec", "shl", "shr", "sar", "sal"), "")


def _compared(relation: str, a: float, b: float) -> bool:
    """Whether a relation of IR holds between numbers that are known."""
    unordered = a != a or b != b
    if relation in ("uno", "ord"):
        return unordered is (relation == "uno")
    if len(relation) == 3 and relation[0] in "ou":
        if unordered:
            return relation[0] == "u"
        relation = relation[1:]
    return {"eq": a == b, "ne": a != b, "gt": a > b, "ge": a >= b, "lt": a < b, "le": a <= b}[
        relation
    ]


@cache
def _register(name: str) -> tuple[str, int, int]:
    """The whole register of a name, whether it is its second byte, and its bits."""
    if name.startswith(("xmm", "ymm")):
        return f"xmm{name[3:]}", 0, 64
    if of_number := re.fullmatch(r"r(\d+)([dwb]?)", name):
        return f"r{of_number[1]}", 0, {"": 64, "d": 32, "w": 16, "b": 8}[of_number[2]]
    if re.fullmatch("[abcd][hl]", name):
        return f"r{name[0]}x", int(name[1] == "h"), 8
    if name in ("sil", "dil", "bpl", "spl"):
        return f"r{name[:2]}", 0, 8
    size = {"r": 64, "e": 32}.get(name[0], 16)
    return f"r{name[-2:]}", 0, size
