"""Readers of .mat (version 5) and universal files written from the formats' descriptions, to read what others wrote."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
STRUCT, CHAR = 2, 4


def read_mat5(path: Path) -> dict[str, Any]:
    """Variables of a .mat file after MathWorks' "MAT-File Format", level 5: structs, text, numbers."""
    content, at, found = path.read_bytes(), 128, {}
    while at < len(content):
        kind, size = struct.unpack_from("<II", content, at)
        body = content[at + 8 : at + 8 + size]
        at += 8 + size
        if kind == 15:
            body = zlib.decompress(body)
            kind, size = struct.unpack_from("<II", body)
            body = body[8 : 8 + size]
        name, value = _matrix(body)
        found[name] = value
    return found


def _elements(body: bytes) -> list[tuple[int, bytes]]:
    found, at = [], 0
    while at < len(body):
        kind, size = struct.unpack_from("<HH", body, at)
        if size:  # the small form: four bytes beside the tag
            found.append((kind, body[at + 4 : at + 4 + size]))
            at += 8
        else:
            kind, size = struct.unpack_from("<II", body, at)
            found.append((kind, body[at + 8 : at + 8 + size]))
            at += 8 + size + (-size) % 8
    return found


def _matrix(body: bytes) -> tuple[str, Any]:
    parts = _elements(body)
    flags = struct.unpack_from("<I", parts[0][1])[0]
    shape = np.frombuffer(parts[1][1], "<i4")
    name = parts[2][1].decode()
    if flags & 0xFF == STRUCT:
        width = struct.unpack("<i", parts[3][1])[0]
        names = [parts[4][1][k : k + width].split(b"\0")[0].decode() for k in range(0, len(parts[4][1]), width)]
        return name, {field: _matrix(part)[1] for field, (_, part) in zip(names, parts[5:], strict=True)}
    values = [np.frombuffer(part, "<" + KINDS[kind]) if kind in KINDS else part.decode() for kind, part in parts[3:]]
    if flags & 0xFF == CHAR:
        return name, values[0] if isinstance(values[0], str) else "".join(map(chr, values[0]))
    whole = values[0] + 1j * values[1] if flags & 0x800 else values[0]
    return name, whole.reshape(shape, order="F").squeeze()


def read_58(path: Path) -> list[dict[str, Any]]:
    """Datasets 58 and 58b, evenly spaced, after the universal file's description of SDRC."""
    content, at, found = path.read_bytes(), 0, []
    units = content.split(b"\n")[:6]
    assert [line.split() for line in (units[0], units[1], units[-1])] == [[b"-1"], [b"164"], [b"-1"]]
    assert (int(units[2][:10]), float(units[3][:25].replace(b"D", b"E"))) == (1, 1.0)
    at = sum(len(line) + 1 for line in units)
    while content[at:].strip():
        lines = []
        for _ in range(13):
            end = content.index(b"\n", at)
            lines.append(content[at:end].decode())
            at = end + 1
        assert lines[0].split() == ["-1"]
        binary = lines[1][6] == "b"
        kind, count, even = int(lines[8][:10]), int(lines[8][10:20]), int(lines[8][20:30])
        assert lines[1][:6].strip() == "58"
        assert even == 1
        many = count * (2 if kind == 6 else 1)
        if binary:
            assert int(lines[1][31:43]) == 8 * many  # bytes that follow, as the head says
            values, at = np.frombuffer(content[at : at + 8 * many], "<f8"), at + 8 * many
            end = content.index(b"\n", at)
        else:
            end = content.index(b"\n    -1", at)
            values = np.array(content[at:end].split(), dtype=float)
            end = content.index(b"\n", end + 1)
        assert content[at : end + 1].split()[-1] == b"-1"
        at = end + 1
        found.append(
            {
                "type": int(lines[7][:5]), "response": lines[7][31:41].strip(), "reference": lines[7][56:66].strip(),
                "node": int(lines[7][41:51]), "direction": int(lines[7][51:55]), "reference_node": int(lines[7][66:76]),
                "told": lines[2].strip(), "step": float(lines[8][43:56]), "unit": lines[10].split()[-1],
                "types": (int(lines[10][:10]), int(lines[11][:10])), "below": lines[11].split()[-1],
                "values": values[::2] + 1j * values[1::2] if kind == 6 else values,
            }
        )  # fmt: skip
    return found
