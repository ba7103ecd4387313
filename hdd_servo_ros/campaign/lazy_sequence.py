"""Sequences whose items are made when they are asked for."""

import abc
from collections.abc import Sequence
from typing import TypeVar, overload

Item = TypeVar('Item', covariant=True)


class LazySequence(Sequence[Item]):
    """A sequence that makes an item, or a list of those of a slice, when it is asked for them."""

    called = 'item'
    """What an item is called in an error."""

    @overload
    def __getitem__(self, index: int) -> Item: ...

    @overload
    def __getitem__(self, index: slice) -> list[Item]: ...

    def __getitem__(self, index: int | slice) -> Item | list[Item]:
        """Return an item, from the end if the index is negative; raises IndexError if there is none."""
        if isinstance(index, slice):
            return [self._item(one) for one in range(len(self))[index]]
        if not -len(self) <= index < len(self):
            raise IndexError(f'there is no {self.called} {index}, only 0 to {len(self) - 1}')
        return self._item(index % len(self))

    @abc.abstractmethod
    def _item(self, index: int) -> Item:
        """Return the item of an index from 0 on, which is there."""
