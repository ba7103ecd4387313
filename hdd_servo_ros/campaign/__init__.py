"""Campaigns: many runs from one specification, their workers, and the table of results."""

from typing import TYPE_CHECKING

from hdd_servo_ros.lazy import lazily

if TYPE_CHECKING:
    from hdd_servo_ros.campaign.campaign import Campaign
    from hdd_servo_ros.campaign.table import Table

__all__ = [
    'Campaign',
    'Table',
]

__getattr__ = lazily(
    __name__,
    {
        'Campaign': '.campaign',
        'Table': '.table',
    },
)
