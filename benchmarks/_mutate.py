"""Ways to damage a file: each gives other bytes, and the same for the same generator."""

import re
from collections.abc import Callable, Iterator

import numpy as np

Mutation = Callable[[bytes, np.random.Generator], bytes]

HEADER = 96  # bytes that most fields of sizes, rates and counts lie in
FIELDS = (0, 1, 2, 3, 7, 255, 1024, 0x7FFF, 0x8000, 0xFFFF, 10**6, 0x7FFFFFFF, 0x80000000,
          0xFFFFFFFE, 0xFFFFFFFF)  # fmt: skip
LONG_FIELDS = (0, 10**12, 2**63 - 1, 2**63, 2**64 - 1)
WORDS = (b"0", b"-1", b"1", b"nan", b"-inf", b"1e300", b"-1e-320", b"1e9999", b"9" * 400,
         b"9" * 5000, b"", b"\0", "\u00e9\u4e2d\u202e".encode(), b"\xff\xfe", b'"', b"'", b"{",
         b"[", b"null", b"true", b"1,5", b"../../x", b"/dev/zero", b"!!python/object:os.system",
         b"*a", b"\x1b[31m", b"\r", b"\n", b"=1+1", b"<a>", b"&x;")  # fmt: skip
TOKEN = re.compile(rb"[^\s,;:<>\"'{}\[\]=/]+")


def mutated(seed: bytes, count: int, *, text: bool, number: int = 0) -> Iterator[tuple[str, bytes]]:
    """Name and content of so many damaged versions of a file.

    Args:
        seed: The valid file.
        count: How many; every way is taken in turn.
        text: Whether it consists of words, which are then exchanged as well.
        number: Of the file, so that two of one content are damaged differently.
    """
    ways = {**ANY, **(OF_TEXT if text else OF_HEADERS)}
    rng = np.random.default_rng([len(seed), number])
    for place in range(count):
        name, way = list(ways.items())[place % len(ways)]
        yield name, way(seed, rng)


def _place(seed: bytes, rng: np.random.Generator) -> int:
    """A place in the file, half of the time in its header."""
    end = min(len(seed), HEADER) if rng.random() < 0.5 else len(seed)
    return int(rng.integers(0, max(1, end)))


def flip_bits(seed: bytes, rng: np.random.Generator) -> bytes:
    content = bytearray(seed)
    for _ in range(int(rng.integers(1, 9))):
        content[_place(seed, rng)] ^= 1 << int(rng.integers(8))
    return bytes(content)


def truncate(seed: bytes, rng: np.random.Generator) -> bytes:
    return seed[: _place(seed, rng)]


def insert(seed: bytes, rng: np.random.Generator) -> bytes:
    place = _place(seed, rng)
    return seed[:place] + rng.bytes(int(rng.integers(1, 64))) + seed[place:]


def replace_all(seed: bytes, rng: np.random.Generator) -> bytes:
    """Nothing, zeros, noise or text instead of the file."""
    size = int(rng.integers(1, 4096))
    text = "".join(map(chr, rng.integers(32, 0x3000, size))).encode()
    return [b"", bytes(size), rng.bytes(size), text][int(rng.integers(4))]


def put_field(seed: bytes, rng: np.random.Generator) -> bytes:
    """An extreme number where the header may have a size, a rate or a count."""
    order = "little" if rng.random() < 0.7 else "big"
    size = int(rng.choice([1, 2, 4, 8]))
    value = int(rng.choice(FIELDS)) if size < 8 else LONG_FIELDS[int(rng.integers(5))]
    place = _place(seed, rng) // 2 * 2
    field = (value % 2 ** (8 * size)).to_bytes(size, order)  # type: ignore[arg-type]
    return seed[:place] + field + seed[place + size :]


def put_float(seed: bytes, rng: np.random.Generator) -> bytes:
    """NaN, infinity or a huge or tiny number among the samples."""
    value = rng.choice([np.nan, np.inf, -np.inf, 3e38, -1e30, 1e-40, 0])
    field = np.array(value, rng.choice(["<f4", "<f8", ">f4", ">f8"])).tobytes()
    place = _place(seed, rng) // 4 * 4
    return seed[:place] + field + seed[place + len(field) :]


def put_word(seed: bytes, rng: np.random.Generator) -> bytes:
    """Another word or number for one that is there."""
    found = list(TOKEN.finditer(seed))
    match = found[int(rng.integers(min(len(found), 20 if rng.random() < 0.5 else len(found))))]
    return seed[: match.start()] + WORDS[int(rng.integers(len(WORDS)))] + seed[match.end() :]


def edit_lines(seed: bytes, rng: np.random.Generator) -> bytes:
    """A line taken out, twice, elsewhere, cut in two, or of other cells."""
    lines = seed.splitlines(keepends=True)
    place, other = (int(rng.integers(len(lines))) for _ in range(2))
    line = lines.pop(place)
    way = int(rng.integers(5))
    if way:
        half = line[: len(line) // 2]
        new = (line * 2, line, half + b"\n" + line, half + b",,;" + line)
        lines.insert(other if way == 2 else place, new[way - 1])
    return b"".join(lines)


def nest(seed: bytes, rng: np.random.Generator) -> bytes:
    """Thousands of brackets."""
    bracket = [b"[", b"{", b"<a>", b"(", b'{"a":'][int(rng.integers(5))]
    place = _place(seed, rng) if rng.random() < 0.5 else 0
    return seed[:place] + bracket * 20_000 + seed[place:]


ANY: dict[str, Mutation] = {
    each.__name__: each for each in (flip_bits, truncate, insert, replace_all)
}
OF_HEADERS: dict[str, Mutation] = {
    "put_field": put_field,
    "put_field_again": put_field,
    "put_field_more": put_field,
    "put_float": put_float,
}
OF_TEXT: dict[str, Mutation] = {
    "put_word": put_word,
    "put_word_again": put_word,
    "put_word_more": put_word,
    "edit_lines": edit_lines,
    "nest": nest,
}
