"""What all parts share: numbers, checksum, state hash."""

import struct

MASK32, MASK64 = 2**32 - 1, 2**64 - 1


class Refused(Exception):
    """A body that must be refused; the text is the word that the vectors have for the reason."""


def must(condition, reason):
    if not condition:
        raise Refused(reason)


def sig(value):
    return value.bit_length()


def clamp(value, low, high):
    return max(low, min(high, value))


def toward_zero(a, b):
    """a / b of whole numbers, rounded towards 0."""
    return abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)


def fold_sign(value):
    return 2 * value if value >= 0 else -2 * value - 1


def unfold_sign(value):
    return value // 2 if value % 2 == 0 else -(value + 1) // 2



def crc_of_byte(byte):
    for _ in range(8):
        byte = byte >> 1 ^ (0x82F63B78 if byte & 1 else 0)
    return byte


CRC_TABLE = [crc_of_byte(byte) for byte in range(256)]


def crc32c(data):
    crc = MASK32
    for byte in data:
        crc = crc >> 8 ^ CRC_TABLE[(crc ^ byte) & 255]
    return crc ^ MASK32


def hash_round(x):
    p = x * 0x9E3779B97F4A7C15 & MASK64
    return p ^ p >> 32


def hash_fold(digest, words):
    for at in range(0, len(words), 2):
        high = words[at + 1] if at + 1 < len(words) else 0
        digest = hash_round(digest ^ (high << 32 | words[at]))
    return digest


def term(kind, index, words):
    if not any(words):
        return 0
    h = hash_fold(hash_round(kind << 32 | index), words)
    h = (h ^ h >> 29) * 0xBF58476D1CE4E5B9 & MASK64
    return h ^ h >> 32


def f32_bits(value):
    return struct.unpack("<I", struct.pack("<f", value))[0]


def f32(value):
    """The binary32 number that a decimal number stands for."""
    return struct.unpack("<f", struct.pack("<f", value))[0]
