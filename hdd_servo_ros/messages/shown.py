"""Values in user-visible messages: one line of limited length."""

import reprlib

LONGEST = 80
"""Maximum length of a value in a message [characters]."""


def shown(value: object, longest: int = LONGEST) -> str:
    """
    Return a value for a message: its ``repr``, truncated to ``longest`` characters.

    The complete ``repr`` is not built if it may be huge: a list of lists that repeats itself, or an integer of
    thousands of digits, which Python does not convert.
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
        # The length would multiply with nested containers.
        if level < self.maxlevel - 1:
            self.maxtuple = self.maxlist = self.maxdict = self.maxset = 4
        return super().repr1(x, level)

    def repr_str(self, x: str, level: int) -> str:
        return repr(x if len(x) <= self.maxstring else x[: self.maxstring])

    def repr_int(self, x: int, level: int) -> str:
        return f'an integer of {x.bit_length()} bits' if x.bit_length() > 2048 else repr(x)
