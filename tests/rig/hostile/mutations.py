"""Ways in which a file goes wrong: by a disk, by a copy that broke off, by an editor, by another program."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

Random = np.random.Generator
Mutation = Callable[[bytes, Random], bytes]

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_ODD_NUMBERS = (
    b"0",
    b"-1",
    b"1e308",
    b"1e-308",
    b"nan",
    b"inf",
    b"-inf",
    b"9" * 5000,
    b"0x" + b"f" * 5000,
    b"4294967296",
    b"true",
    b'"seven"',
    b"[]",
    b"{}",
    b"null",
)


def flip_a_bit(data: bytes, random: Random) -> bytes:
    """One bit of one byte."""
    k = int(random.integers(len(data)))
    return data[:k] + bytes([data[k] ^ (1 << int(random.integers(8)))]) + data[k + 1 :]


def change_a_digit(data: bytes, random: Random) -> bytes:
    """One digit to another; a bit where there is none."""
    places = [match.start() for match in re.finditer(rb"\d", data)]
    if not places:
        return flip_a_bit(data, random)
    k = places[int(random.integers(len(places)))]
    other = (data[k] - ord("0") + int(random.integers(1, 10))) % 10
    return data[:k] + bytes([ord("0") + other]) + data[k + 1 :]


def cut_off(data: bytes, random: Random) -> bytes:
    """A copy that broke off."""
    return data[: int(random.integers(len(data)))]


def zero_a_block(data: bytes, random: Random) -> bytes:
    """A block of the disk that was never written."""
    k = int(random.integers(len(data)))
    return data[:k] + bytes(min(64, len(data) - k)) + data[k + 64 :]


def insert_no_text(data: bytes, random: Random) -> bytes:
    """Bytes that are no UTF-8."""
    k = int(random.integers(len(data)))
    return data[:k] + b"\xff\xfe\xc0" + data[k:]


def put_an_odd_number(data: bytes, random: Random) -> bytes:
    """A number replaced by one that is too large, none, or no number."""
    places = list(_NUMBER.finditer(data))
    if not places:
        return cut_off(data, random)
    chosen = places[int(random.integers(len(places)))]
    return data[: chosen.start()] + _ODD_NUMBERS[int(random.integers(len(_ODD_NUMBERS)))] + data[chosen.end() :]


def lose_a_line(data: bytes, random: Random) -> bytes:
    """A line is missing."""
    lines = data.splitlines(keepends=True)
    del lines[int(random.integers(len(lines)))]
    return b"".join(lines)


def double_a_line(data: bytes, random: Random) -> bytes:
    """A line comes twice."""
    lines = data.splitlines(keepends=True)
    k = int(random.integers(len(lines)))
    return b"".join([*lines[: k + 1], *lines[k:]])


def fill_with_noise(data: bytes, random: Random) -> bytes:
    """Another file, of the same size, under its name."""
    return random.bytes(min(len(data), 4096))


def empty(_data: bytes, _random: Random) -> bytes:
    """Nothing."""
    return b""


def nest(data: bytes, random: Random) -> bytes:
    """Brackets a hundred thousand deep."""
    k = int(random.integers(len(data)))
    return data[:k] + b"[" * 100_000 + data[k:]


def with_number(data: bytes, place: int, number: bytes) -> bytes:
    """Another number in the place of one; places begin again where they end."""
    places = list(_NUMBER.finditer(data))
    match = places[place % len(places)]
    return data[: match.start()] + number + data[match.end() :]


MUTATIONS: tuple[Mutation, ...] = (
    flip_a_bit,
    change_a_digit,
    change_a_digit,
    cut_off,
    zero_a_block,
    insert_no_text,
    put_an_odd_number,
    put_an_odd_number,
    put_an_odd_number,
    lose_a_line,
    double_a_line,
    fill_with_noise,
    empty,
    nest,
)


def mutated(data: bytes, seed: int) -> bytes:
    """Return what a seed makes of a file's bytes; never the same bytes."""
    random = np.random.default_rng(seed)
    mutation = MUTATIONS[seed % len(MUTATIONS)]
    for _ in range(20):
        other = mutation(data, random)
        if other != data:
            return other
    return data + b"\0"
