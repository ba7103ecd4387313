"""Sequences whose items are computed on access."""

import abc
from collections.abc import Sequence
from typing import TypeVar, overload

Item = TypeVar('Item', covariant=True)


class LazySequence(Sequence[Item]):
    """A sequence that computes an item, or the list of a slice, on access."""

    called = 'item'
    """Name of an item in error messages."""

    @overload
    def __getitem__(self, index: int) -> Item: ...

    @overload
    def __getitem__(self, index: slice) -> list[Item]: ...

    def __getitem__(self, index: int | slice) -> Item | list[Item]:
        """Return an item, counted from the end for a negative index; raises IndexError beyond the ends."""
        if isinstance(index, slice):
            return [self._item(one) for one in range(len(self))[index]]
        if not -len(self) <= index < len(self):
            raise IndexError(f'{self.called} {index} does not exist; expected 0 to {len(self) - 1}')
        return self._item(index % len(self))

    @abc.abstractmethod
    def _item(self, index: int) -> Item:
        """Return the item at a valid index of at least 0."""
