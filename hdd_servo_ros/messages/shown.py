"""Values in messages for people: one line, and never longer than a line should be."""

import reprlib

LONGEST = 80
"""Characters of a value that a message shows."""


def shown(value: object, longest: int = LONGEST) -> str:
    """
    Return a value as a message shows it: its ``repr``, cut to ``longest`` characters.

    The ``repr`` is never made whole where it may be huge: a list of lists that repeats itself, or an integer of
    thousands of digits, which Python rejects to write.
    """
    text = _Repr().repr(value)
    return text if len(text) <= longest else f'{text[: longest - 3]}...'


class _Repr(reprlib.Repr):
    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 4
        self.maxtuple = self.maxlist = self.maxdict = self.maxset = self.maxfrozenset = self.maxarray = LONGEST
        self.maxstring = self.maxother = 4 * LONGEST

    def repr1(self, x: object, level: int) -> str:
        # Containers within containers would multiply.
        if level < self.maxlevel - 1:
            self.maxtuple = self.maxlist = self.maxdict = self.maxset = 4
        return super().repr1(x, level)

    def repr_str(self, x: str, level: int) -> str:
        return repr(x if len(x) <= self.maxstring else x[: self.maxstring])

    def repr_int(self, x: int, level: int) -> str:
        return f'an integer of {x.bit_length()} bits' if x.bit_length() > 2048 else repr(x)
