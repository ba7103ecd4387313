"""
CRC-32 of two concatenated pieces of data, computed from the CRC-32 of each piece.

MCAP has one checksum per chunk and one of the whole data section. Without this function, every byte would have to be
read twice, which takes as long as writing it. The function corresponds to ``crc32_combine`` of zlib, which Python's
module lacks. A CRC is a polynomial over GF(2), bit-reversed (the highest bit is the coefficient of x^0), and data that
follow multiply it by x^(8 size).
"""

import functools

_POLYNOMIAL = 0xEDB88320
_ONE = 1 << 31
_X = 1 << 30


def combined_crc(first: int, second: int, size: int) -> int:
    """
    Return the CRC-32 of two concatenated pieces of data.

    Parameters
    ----------
    first, second
        CRC-32 of each piece, as returned by `zlib.crc32`.
    size
        Size of the second piece [bytes].
    """
    return _product(first, _power_of_x(8 * size)) ^ second


@functools.lru_cache(maxsize=64)
def _power_of_x(exponent: int) -> int:
    """Return x^exponent modulo the polynomial, by squaring."""
    power, square = _ONE, _X
    while exponent:
        if exponent & 1:
            power = _product(power, square)
        square = _product(square, square)
        exponent >>= 1
    return power


def _product(left: int, right: int) -> int:
    """Return the product of two polynomials modulo the polynomial of CRC-32."""
    product = 0
    for bit in range(31, -1, -1):
        if left >> bit & 1:
            product ^= right
        # Multiply by x for the next lower bit of the other polynomial.
        right = right >> 1 ^ (_POLYNOMIAL if right & 1 else 0)
    return product
