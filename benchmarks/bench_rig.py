"""
Measure the speed of the rig, with intra-process queues and over DDS, against the DDS lower bound.

``python -m benchmarks.bench_rig [--quick]`` prints the real-time factors of every round, and the table rows. All
topics are recorded. The benchmarks of a round follow each other, so that a slow minute affects all of them.
"""

import argparse
import statistics
import tempfile

from benchmarks.graph_runs import Bench, alternating

OVER_DDS = ('-p', 'rig:intra_process:=false')


def rig_values(bench, repeats, ticks, **others):
    """
    Run all benchmarks alternately, several times.

    Parameters
    ----------
    bench
        Runner of the graph.
    repeats, ticks
        Number of rounds, and length of each run.
    others
        Further benchmarks of each round.

    Returns
    -------
    dict
        Real-time factors by benchmark.
    """
    return alternating(
        repeats,
        rig=lambda: bench.rig(ticks),
        rig_over_dds=lambda: bench.rig(ticks, *OVER_DDS),
        lower_bound=lambda: bench.lower_bound(ticks),
        **others,
    )


def rig_rows(values):
    """Return table rows, with the ratios to the lower bound of the same rounds and to the default executor."""
    median = statistics.median
    rig, over_dds, lower_bound = (median(values[name]) for name in ('rig', 'rig_over_dds', 'lower_bound'))
    to_bound, to_bound_over_dds = (
        median(factor / bare for factor, bare in zip(values[name], values['lower_bound'], strict=True))
        for name in ('rig', 'rig_over_dds')
    )
    default = f'; {rig / median(values["default"]):.1f} times the default executor' if 'default' in values else ''
    return [
        (
            '`rig`, all topics recorded',
            f'{rig:.2f}',
            'at least 1.2 times the lower bound, goal 2',
            f'{to_bound:.2f} times the lower bound{default}',
        ),
        (
            '`rig` with `intra_process:=false`',
            f'{over_dds:.2f}',
            '',
            f'{to_bound_over_dds:.2f} times the lower bound',
        ),
        ('lower bound: serialized publish and take over DDS alone', f'{lower_bound:.2f}', '', ''),
    ]


def main():
    """Print the values of every round, and the medians."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.bench_rig', description=__doc__.splitlines()[1])
    parser.add_argument('--quick', action='store_true', help='run one short round, as a smoke test')
    options = parser.parse_args()
    repeats, ticks = (1, 2000) if options.quick else (5, 20_000)
    with tempfile.TemporaryDirectory() as directory:
        for row in rig_rows(rig_values(Bench(directory), repeats, ticks)):
            print(' | '.join(row))


if __name__ == '__main__':
    main()
