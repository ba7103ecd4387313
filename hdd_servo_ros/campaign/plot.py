"""The plot of a campaign: the distribution of a metric, and the metric over each varied parameter."""

from pathlib import Path

import numpy as np

from hdd_servo_ros.campaign.campaign import Campaign
from hdd_servo_ros.campaign.table import Table

_PARAMETERS = 3
"""Number of varied parameters in the plot, the first ones."""


def write_plot(campaign: Campaign, table: Table, folder: Path) -> Path | None:
    """
    Write ``campaign.png`` into the directory of a campaign, and return its path; None if no run has a metric.

    Parameters
    ----------
    campaign, table
        The campaign and its table; the metric is the one that ranks the worst runs.
    folder
        Its directory.
    """
    # Imported late: only the plot needs matplotlib.
    from matplotlib.figure import Figure

    metric = campaign.worst_metric(table)
    if not metric or not np.isfinite(table[metric]).any():
        return None
    parameters = [key for key in campaign.plan.varied if table.is_number(key)][:_PARAMETERS]
    label = f'{metric} [{table.units[metric]}]' if metric in table.units else metric
    figure = Figure(figsize=(3.4 * (1 + len(parameters)), 3.2), layout='constrained')
    axes = np.atleast_1d(figure.subplots(1, 1 + len(parameters)))
    for controller in dict.fromkeys(table['controller'].tolist()):
        own = table.where(controller=controller)
        values = own[metric]
        found = np.sort(values[np.isfinite(values)])
        # Runs without the metric count as worse than all others.
        axes[0].step(found, np.arange(1, len(found) + 1) / len(values), where='post', label=controller)
        for ax, name in zip(axes[1:], parameters, strict=True):
            ax.plot(own[name], values, '.', markersize=3)
    axes[0].set(xlabel=label, ylabel='fraction of the runs', ylim=(0.0, 1.02))
    axes[0].legend(fontsize='small')
    for ax, name in zip(axes[1:], parameters, strict=True):
        ax.set(xlabel=name.rpartition(':')[2], ylabel=label)
    path = folder / 'campaign.png'
    figure.savefig(path, dpi=110, metadata={'Software': None})
    return path
