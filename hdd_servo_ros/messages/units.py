"""Units of a drive, on topics and for display."""

import dataclasses

_LENGTH, _CONTROL = 'um', 'V'


@dataclasses.dataclass(frozen=True)
class Units:
    """
    Units of a drive; the topics are declared for a drive in um and V.

    Attributes
    ----------
    length, control
        Units of positions and of the control signal, as in the drive's parameter file.
    """

    length: str = _LENGTH
    control: str = _CONTROL

    @property
    def error(self) -> str:
        """Unit for the display of errors: nm if lengths are in um, otherwise the unit of lengths."""
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
    """Return a unit for display: µm for um, µs for us."""
    return unit.replace('um', 'µm').replace('us', 'µs')
