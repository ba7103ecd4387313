"""Units of a drive, decided in one place: what the topics carry, and what a person is shown."""

import dataclasses

_LENGTH, _CONTROL = 'um', 'V'


@dataclasses.dataclass(frozen=True)
class Units:
    """
    The units of a drive; the topics' declarations are written for one in um and V.

    Attributes
    ----------
    length, control
        Units of positions and of the control signal, as the drive's parameter file names them.
    """

    length: str = _LENGTH
    control: str = _CONTROL

    @property
    def error(self) -> str:
        """Unit in which errors are shown: nm where lengths are in um, else the unit of lengths."""
        return 'nm' if self.length == 'um' else self.length

    @property
    def error_factor(self) -> float:
        """Factor from the unit of lengths to that of errors."""
        return 1e3 if self.length == 'um' else 1.0

    def of(self, declared: str) -> str:
        """Return a declared unit, such as ``um/s`` or ``V``, in the units of this drive."""
        parts = (self._named.get(part, part) for part in declared.replace('/', ' / ').split(' '))
        return ' '.join(parts).replace(' / ', '/')

    @property
    def _named(self) -> dict[str, str]:
        return {_LENGTH: self.length, _CONTROL: self.control}


def shown(unit: str) -> str:
    """Return a unit as it is written for people: µm for um, µs for us."""
    return unit.replace('um', 'µm').replace('us', 'µs')
