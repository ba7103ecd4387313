"""Bode plots of measured and fitted frequency responses."""

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hdd_servo_ros.bench.response import FrequencyResponse, decibels, degrees
from hdd_servo_ros.messages.units import shown


def bode(responses: dict[str, FrequencyResponse], title: str = '') -> Figure:
    """
    Plot gain and phase, and the coherence if it was measured.

    Parameters
    ----------
    responses
        At least one response by label, all in the same unit; the first is drawn as points, the others as lines.
    title
        Title of the figure.
    """
    measured = [response for response in responses.values() if response.averages.min() > 1]
    figure = Figure(figsize=(8.5, 7.5), layout='constrained')
    FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title)
    heights = (3, 2, 1)[: 3 if measured else 2]
    axes = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    gain, phase = axes[0], axes[1]
    for i, (label, response) in enumerate(responses.items()):
        style = {'marker': '.', 'markersize': 3.5, 'linewidth': 0.8} if i == 0 else {'linewidth': 1.2}
        gain.semilogx(response.frequency, decibels(response), label=label, **style)
        phase.semilogx(response.frequency, degrees(response), **style)
    unit = shown(next(iter(responses.values())).unit)
    gain.set_ylabel(f'gain [dB, {unit}]')
    phase.set_ylabel('phase [°]')
    if len(responses) > 1:
        gain.legend(fontsize=8)
    for response in measured:
        axes[2].semilogx(response.frequency, response.coherence, linewidth=0.8)
        axes[2].set_ylabel('coherence')
        axes[2].set_ylim(0.0, 1.05)
    axes[-1].set_xlabel('frequency [Hz]')
    for axis in axes:
        axis.grid(which='both', alpha=0.3)
    return figure
