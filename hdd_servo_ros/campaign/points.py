"""The points of a campaign, computed on access, so that many points take no memory."""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

from hdd_servo_ros.campaign.lazy_sequence import LazySequence

MOST = 1_000_000
"""Largest number of runs: a day of short runs on two cores, and a table that fits in memory."""


@dataclasses.dataclass(frozen=True)
class Varied:
    """
    The value of a varied parameter in one run.

    Attributes
    ----------
    value
        The value, or a factor of the base value.
    times_base
        Whether the value is a factor of the base value (of each element of a list).
    """

    value: object
    times_base: bool = False


Point = dict[str, Varied]
"""Values by ``'node:parameter'``, or by ``'node:parameter[index]'`` for elements of lists."""


@dataclasses.dataclass(frozen=True)
class Column:
    """
    The values of one parameter of a block.

    Attributes
    ----------
    values
        One per point.
    times_base
        Whether they are factors of the base value.
    """

    values: Sequence[object]
    times_base: bool = False


class Block(LazySequence[Point]):
    """
    Points whose parameters are zipped.

    Parameters
    ----------
    columns
        At least one column, by parameter; all have the same length.
    """

    def __init__(self, columns: Mapping[str, Column]) -> None:
        self.columns = dict(columns)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())).values)

    def _item(self, index: int) -> Point:
        return {key: Varied(column.values[index], column.times_base) for key, column in self.columns.items()}


class Points(LazySequence[Point]):
    """
    The product of blocks: each point of one with each of the others; the last block varies fastest.

    Parameters
    ----------
    blocks
        The blocks, without common parameters; no blocks give one empty point.
    """

    def __init__(self, blocks: Sequence[Sequence[Point]]) -> None:
        self.blocks = tuple(blocks)

    def __len__(self) -> int:
        return math.prod(map(len, self.blocks))

    def __iter__(self) -> Iterator[Point]:
        for chosen in itertools.product(*(range(len(block)) for block in self.blocks)):
            yield self._crossed(chosen)

    def _item(self, index: int) -> Point:
        chosen = []
        for block in reversed(self.blocks):
            index, own = divmod(index, len(block))
            chosen.append(own)
        return self._crossed(chosen[::-1])

    def _crossed(self, chosen: Sequence[int]) -> Point:
        return {
            key: varied
            for block, index in zip(self.blocks, chosen, strict=True)
            for key, varied in block[index].items()
        }
