"""
How fast the rig is: its nodes handing each other their messages, or over DDS, beside the bare DDS floor.

``python -m benchmarks.bench_rig [--quick]`` prints the real-time factors of every round, and the table's rows. All
topics are recorded; the figures of a round are measured one after the other, so that a slow minute strikes all.
"""

import argparse
import statistics
import tempfile

from benchmarks.graph_runs import Bench, alternating

OVER_DDS = ('-p', 'rig:intra_process:=false')


def rig_figures(bench, repeats, ticks, **others):
    """
    Measure in turn, several times.

    Parameters
    ----------
    bench
        What runs the graph.
    repeats, ticks
        Number of rounds, and length of each run.
    others
        Further measures of each round.

    Returns
    -------
    dict
        The real-time factors of each measure.
    """
    return alternating(
        repeats,
        rig=lambda: bench.rig(ticks),
        rig_over_dds=lambda: bench.rig(ticks, *OVER_DDS),
        floor=lambda: bench.floor(ticks),
        **others,
    )


def rig_rows(figures):
    """Return the rows of the table, with the ratios to the floor of the same rounds, and to the stock executor."""
    median = statistics.median
    rig, over_dds, floor = (median(figures[name]) for name in ('rig', 'rig_over_dds', 'floor'))
    beside_floor, beside_floor_over_dds = (
        median(factor / bare for factor, bare in zip(figures[name], figures['floor'], strict=True))
        for name in ('rig', 'rig_over_dds')
    )
    stock = f'; {rig / median(figures["stock"]):.1f} times the stock executor' if 'stock' in figures else ''
    return [
        (
            '`rig`, all topics recorded',
            f'{rig:.2f}',
            'at least 1.2 times the floor, aim 2',
            f'{beside_floor:.2f} times the floor{stock}',
        ),
        (
            '`rig` with `intra_process:=false`',
            f'{over_dds:.2f}',
            '',
            f'{beside_floor_over_dds:.2f} times the floor',
        ),
        ('floor: bare serialized publish and take over DDS', f'{floor:.2f}', '', ''),
    ]


def main():
    """Print the figures of every round, and the medians."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.bench_rig', description=__doc__.splitlines()[1])
    parser.add_argument('--quick', action='store_true', help='one short round, to see that it works')
    options = parser.parse_args()
    repeats, ticks = (1, 2000) if options.quick else (5, 20_000)
    with tempfile.TemporaryDirectory() as directory:
        for row in rig_rows(rig_figures(Bench(directory), repeats, ticks)):
            print(' | '.join(row))


if __name__ == '__main__':
    main()
