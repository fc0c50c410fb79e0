"""Object files of three formats: for which processor, and what they take from elsewhere."""

import struct

MACHINES = {
    b"\x7fELF\x02": ("linux x86_64 glibc", 18, 0x3E),
    b"\xcf\xfa\xed\xfe": ("darwin arm64", 4, 0x000C),
    b"\x64\x86": ("win32 AMD64", 0, 0x8664),
}


def platform_of(code):
    """Name of the platform whose format and processor it has."""
    for magic, (name, place, number) in MACHINES.items():
        if code.startswith(magic) and struct.unpack_from("<H", code, place) == (number,):
            return name
    return ""


def taken(code):
    """Names of the functions that a file calls and does not have."""
    reader = {"darwin arm64": _of_mac, "win32 AMD64": _of_windows}.get(platform_of(code), _of_linux)
    return set(reader(code))


def _text(code, place):
    return code[place : code.index(b"\0", place)].decode()


def _of_linux(code):
    (table,), (count,) = struct.unpack_from("<Q", code, 40), struct.unpack_from("<H", code, 60)
    sections = [struct.unpack_from("<IIQQQQII", code, table + 64 * i) for i in range(count)]
    for _, kind, _, _, start, size, link, _ in sections:
        for place in range(start + 24, start + size, 24) if kind == 2 else ():
            name, _, _, section = struct.unpack_from("<IBBH", code, place)
            if section == 0:
                yield _text(code, sections[link][4] + name)


def _of_mac(code):
    place = 32
    for _ in range(struct.unpack_from("<I", code, 16)[0]):
        command, size, symbols, count, names = struct.unpack_from("<5I", code, place)
        for i in range(count) if command == 2 else ():
            name, kind = struct.unpack_from("<IB", code, symbols + 16 * i)
            if kind & 0x0E == 0:
                yield _text(code, names + name).removeprefix("_")
        place += size


def _of_windows(code):
    symbols, count = struct.unpack_from("<II", code, 8)
    i = 0
    while i < count:
        short, _, section, _, _, further = struct.unpack_from("<8sIhHBB", code, symbols + 18 * i)
        if section == 0:
            zeros, place = struct.unpack("<II", short)
            in_table = symbols + 18 * count + place
            yield short.rstrip(b"\0").decode() if zeros else _text(code, in_table)
        i += 1 + further
