"""A metric of a run."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Metric:
    """One metric of a run."""

    name: str
    label: str
    value: float
    unit: str
