"""What a report says is what the bag holds, and its page needs nothing but itself."""

import base64
import html
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import plotly.graph_objects as go
import pytest
import yaml
from matplotlib.figure import Figure
from plotly.offline import get_plotlyjs

from hdd_servo_ros import Run
from hdd_servo_ros.bench.response import read_csv
from hdd_servo_ros.messages.cdr import VectorCodec
from hdd_servo_ros.messages.ticks import Ticks
from hdd_servo_ros.messages.topics import CONTROL, HEAD, REFERENCE
from hdd_servo_ros.recording.bag_writer import BagWriter
from hdd_servo_ros.reporting import plot
from hdd_servo_ros.reporting.comparison_panels import comparison_panels
from hdd_servo_ros.reporting.panel import Panel, Trace
from hdd_servo_ros.reporting.plot import write_plot
from hdd_servo_ros.reporting.reference_period import reference_period
from hdd_servo_ros.reporting.run_metrics import left_out, run_metrics
from hdd_servo_ros.reporting.run_panels import run_panels
from hdd_servo_ros.reporting.show import draw_run
from hdd_servo_ros.reporting.summary import summary
from hdd_servo_ros.tools.report import main

LARGEST_PAGE = 6_000_000
THESIS_LAW = Path(__file__).parents[2] / 'params' / 'thesis_law.yaml'


@pytest.fixture(scope='module')
def runs(simulated, tmp_path_factory):
    """A sine under two controllers, two runs that follow nothing, and a square wave."""
    directory = tmp_path_factory.mktemp('runs')
    arguments = {
        'nn': ['--params-file', str(THESIS_LAW), '-p', 'duration:=1.0'],
        'pid': ['-p', 'duration:=0.5', '-p', 'controller:=pid', '-r', '__ns:=/bench1'],
        'open_loop': [
            '-p',
            'duration:=0.1',
            '-p',
            'controller:=open_loop',
            '-p',
            'reference_generator:amplitude:=0.05',
        ],
        'sweep': [
            *('-p', 'duration:=0.0', '-p', 'controller:=signal_analyzer', '-p', 'start_frequency:=2000.0'),
            *('-p', 'stop_frequency:=3000.0'),
        ],
        'square': ['-p', 'duration:=0.2', '-p', 'waveform:=square', '-p', 'frequency:=20.0'],
    }
    return {name: simulated(directory / name, *given) for name, given in arguments.items()}


@pytest.fixture
def titles(monkeypatch):
    """Keep the titles of the pictures that a report would draw, which is most of its work: other tests draw them."""
    kept = []

    def write_title(panels, title, path):
        assert panels
        kept.append(title)
        path.touch()

    monkeypatch.setattr(plot, 'write_plot', write_title)
    return kept


def numbers(coded):
    """Return what the page's own script makes of coded samples."""
    kind = '<i4' if 'i4' in coded else '<f4'
    values = np.frombuffer(base64.b64decode(coded[kind[1:]]), kind).astype(float)
    return values * coded.get('scale', 1.0)


def figures(page):
    found = re.search(r'^const figures = (.*);$', page, re.MULTILINE)
    assert found is not None
    coded = json.loads(found.group(1))
    for figure in coded:
        for line in figure['data']:
            line['x'], line['y'] = numbers(line['x']), numbers(line['y'])
    return coded


def whole(figure):
    """Return the lines of a figure without those of close-ups, each diagram's in the order of its legend."""
    lines = [line for line in figure['data'] if line['showlegend']]
    return sorted(lines, key=lambda line: (line['yaxis'], line['legendrank']))


class References(HTMLParser):
    """Collects whatever a page would load, and the text of its cells."""

    def __init__(self, text):
        super().__init__()
        self.loaded, self.cells, self.open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.open.append(tag)
        self.loaded += [value for name, value in attributes if name in ('src', 'href', 'srcset', 'data', 'action')]
        if tag in ('link', 'img', 'iframe', 'object'):
            self.loaded.append(tag)

    def handle_data(self, data):
        if self.open and self.open[-1] in ('td', 'th'):
            self.cells.append(data)


def test_a_report_of_one_run(runs, tmp_path, capsys):
    assert main([str(runs['nn']), '--output', str(tmp_path / 'out')]) == 0
    printed = capsys.readouterr().out
    run = Run.open(runs['nn'])
    late = run.time >= 0.5 - 1e-9
    rms = 1e3 * np.sqrt(np.mean(run.error[late] ** 2))

    content = yaml.safe_load((tmp_path / 'out' / 'metrics.yaml').read_text())
    assert content['errors_from'] == 0.5
    assert content['metrics']['rms_error'] == {'value': pytest.approx(rms), 'unit': 'nm'}
    assert f'{rms:.4g}' in printed
    assert matplotlib.image.imread(tmp_path / 'out' / 'report.png').shape[1] == 1300

    page = (tmp_path / 'out' / 'report.html').read_text('utf8')
    assert len(page.encode()) < LARGEST_PAGE
    parsed = References(page)
    assert parsed.loaded == []
    assert f'{rms:.4g} nm' in parsed.cells
    assert 'error_filter_lambda' in parsed.cells
    assert 'url(' not in page.split('<script>')[0]

    time_figure, *others = figures(page)
    for figure in (time_figure, *others):
        go.Figure(figure)  # rejects a property that plotly does not know
    lines = {line['name']: line for line in whole(time_figure)}
    assert {'reference', 'head', 'total', 'feedback part'} < lines.keys()
    head = lines['head']
    rows = np.rint(head['x'] / 1e-4).astype(int)
    np.testing.assert_array_equal(head['y'], run.position[rows].astype(np.float32))
    assert (rows[0], rows[-1]) == (0, run.last_tick)
    assert {*range(500), *range(len(run.ticks) - 500, len(run.ticks))} <= {*rows.tolist()}
    error = next(line for line in time_figure['data'] if line['yaxis'] == 'y2')
    assert np.abs(error['y']).max() == np.float32(1e3 * np.abs(run.error).max())
    close_up = next(line for line in time_figure['data'] if line['name'] == 'head' and not line['showlegend'])
    np.testing.assert_array_equal(close_up['y'], run.position[-301:].astype(np.float32))
    spectrum = others[0]['data'][0]
    assert spectrum['x'][np.argmax(spectrum['y'])] == pytest.approx(300.0, abs=3.0)  # friction's third harmonic
    assert others[1]['layout']['annotations'][0]['text'] == '<b>Hysteresis, last periods</b>'


def test_a_run_is_reported_in_its_own_folder(runs):
    assert main([str(runs['square']), '--after', '0.1']) == 0
    assert yaml.safe_load((runs['square'] / 'metrics.yaml').read_text())['errors_from'] == 0.1
    page = (runs['square'] / 'report.html').read_text('utf8')
    edges = figures(page)[2]
    assert edges['layout']['annotations'][0]['text'] == '<b>Responses to the edges</b>'
    assert len(edges['data']) == 8


def test_several_runs_are_compared(runs, tmp_path, capsys, monkeypatch):
    drawn = []
    monkeypatch.setattr('matplotlib.figure.Figure.suptitle', lambda _, text: drawn.append(text))
    assert main([str(runs['nn']), str(runs['pid'] / 'bag'), '--output', str(tmp_path)]) == 0
    head, *lines = (line.split() for line in capsys.readouterr().out.splitlines() if line.startswith(' '))
    assert head == ['nn', 'pid']
    assert ['controller', 'adaptive_nn', 'pid'] in lines
    assert (tmp_path / 'pid' / 'report.html').is_file()
    assert (tmp_path / 'comparison.png').is_file()
    assert [title.splitlines()[0].rpartition(': ')[2] for title in drawn] == ['nn', 'pid', 'nn, pid']
    time_figure, *others = figures((tmp_path / 'comparison.html').read_text('utf8'))
    assert [line['name'] for line in whole(time_figure)] == ['nn', 'pid', 'nn', 'pid']
    titles = [title['text'] for title in time_figure['layout']['annotations']]
    assert titles == ['<b>Tracking error, x - x_d</b>', '<b>last periods</b>', '<b>Control</b>', '<b>last periods</b>']
    assert len(others) == 1
    # The last periods of the shorter run, sample by sample, of both.
    close_ups = [line for line in time_figure['data'] if not line['showlegend']]
    assert len(close_ups) == 4
    for line in close_ups:
        assert line['x'][[0, -1]].tolist() == pytest.approx([0.47, 0.5])
        assert len(line['x']) == 301


def test_reports_of_one_name_do_not_overwrite_each_other(runs, titles, tmp_path):
    assert main([*map(str, (runs['nn'], runs['nn'] / 'bag', runs['pid'])), '--output', str(tmp_path)]) == 0
    reports = {path.parent.name for path in tmp_path.glob('*/report.html')}
    assert reports == {'nn', 'nn-2', 'pid'}


def test_how_a_run_ended_and_what_it_clipped_is_told_everywhere(runs, titles, tmp_path, capsys):
    """A run that failed, whose vibrometer reached no further than 0.2 V: the 2 um of the sine are 0.25 V."""
    description = yaml.safe_load((runs['pid'] / 'run.yaml').read_text())
    description |= {'status': 'failed', 'reason': 'the drive is gone'}
    description['nodes']['/bench1/ldv_sensor']['parameters']['output_range'] = 0.2
    (tmp_path / 'broken' / 'bag').mkdir(parents=True)
    for file in (runs['pid'] / 'bag').iterdir():
        (tmp_path / 'broken' / 'bag' / file.name).symlink_to(file)
    (tmp_path / 'broken' / 'run.yaml').write_text(yaml.safe_dump(description))
    # The converter of 16 bits and +-10 V ends at its last code within the range.
    code = 20.0 / 2**16
    count = int(np.sum(np.abs(Run.open(runs['pid']).ldv[:, 0]) >= np.floor(0.2 / code) * code))
    assert count > 100
    assert main([str(runs['nn']), str(tmp_path / 'broken'), '--output', str(tmp_path / 'out')]) == 0
    printed = capsys.readouterr().out.splitlines()
    rows = [line.split() for line in printed]
    assert ['status', 'finished', 'failed'] in rows
    assert ['verdict', 'tracks', 'tracks'] in rows
    assert ['saturated', 'samples', 'of', 'the', 'displacement', 'output', '0', str(count)] in rows
    assert 'broken: failed: the drive is gone' in printed
    assert titles[1].endswith(': broken\nfailed: the drive is gone')
    assert titles[2] == 'nn, broken (failed)'
    assert 'finished' not in titles[0]
    content = yaml.safe_load((tmp_path / 'out' / 'broken' / 'metrics.yaml').read_text())
    assert (content['status'], content['reason']) == ('failed', 'the drive is gone')
    assert content['saturated_samples']['displacement output'] == count
    good = yaml.safe_load((tmp_path / 'out' / 'nn' / 'metrics.yaml').read_text())
    assert (good['status'], good['reason'], good['saturated_samples'], good['left_out']) == ('finished', '', {}, [])
    assert 'failed' in References((tmp_path / 'out' / 'comparison.html').read_text('utf8')).cells


def test_a_run_that_does_not_track_is_marked_and_scales_no_picture(runs, simulated, titles, tmp_path, capsys):
    """An unstable PID of a hundred micrometers, next to a run that tracks within half a micrometer."""
    gains = ('-p', 'proportional_gain:=20.0', '-p', 'derivative_gain:=1.0e-3')
    unstable = simulated(tmp_path / 'unstable', '-p', 'duration:=0.2', '-p', 'controller:=pid', *gains)
    assert main([str(runs['nn']), str(unstable), '--output', str(tmp_path / 'out')]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert ['verdict', 'tracks', '!', 'diverged'] in [line.split() for line in printed]
    remark, margin = (line for line in printed if line.startswith('unstable: '))
    assert remark.startswith('unstable: diverged (error up to ')
    assert margin == 'unstable: low stability margin: the linear loop is unstable'
    assert 'diverged' in titles[1].splitlines()[1]
    assert titles[2] == 'nn, unstable (diverged)'
    content = yaml.safe_load((tmp_path / 'out' / 'unstable' / 'metrics.yaml').read_text())
    assert content['verdict']['text'] == 'diverged'
    assert "times the reference's span" in content['verdict']['detail']
    good = yaml.safe_load((tmp_path / 'out' / 'nn' / 'metrics.yaml').read_text())
    assert good['verdict'] == {'text': 'tracks', 'detail': ''}
    page = (tmp_path / 'out' / 'comparison.html').read_text('utf8')
    assert '<td class="marked">! diverged</td>' in page
    error, *_ = comparison_panels([Run.open(runs['nn']), Run.open(unstable)])
    assert [trace.name for trace in error.traces] == ['nn', 'unstable (diverged, clipped)']
    largest = np.abs(error.traces[0].y).max()
    limits = error.range_of(error.traces)
    assert limits is not None
    low, high = limits
    assert 0.5 * largest < max(-low, high) < 1.2 * largest
    assert np.abs(error.traces[1].y).max() > 100.0 * largest
    # The axis of the close-up as well.
    near = error.in_close_up()
    limits_near = error.range_of(near)
    assert limits_near is not None
    assert max(np.abs(limits_near)) < 1.2 * np.abs(near[0].y).max()
    assert figures(page)[0]['layout']['yaxis']['range'] == [low, high]
    # Where none tracks, all scale it.
    (alone, *_) = comparison_panels([Run.open(unstable), Run.open(unstable)])
    assert alone.range_of(alone.traces) is None
    assert 'clipped' not in alone.traces[0].name


def test_a_bag_alone_tells_its_period(runs, titles, tmp_path, capsys):
    """Without run.yaml /reference itself says what repeats, and what is not known is told."""
    (tmp_path / 'alone').symlink_to(runs['nn'] / 'bag')
    assert main([str(tmp_path / 'alone'), '--output', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert (
        'bag: run.yaml is missing: the outcome of the run, its controller, its parameters and saturation are' in printed
    )
    known, alone = Run.open(runs['nn']), Run.open(tmp_path / 'alone')
    assert alone.description == {}
    assert reference_period(alone) == pytest.approx(100.0, rel=1e-9)
    expected = {metric.name: metric.value for metric in run_metrics(known) if 'sensitivity' not in metric.name}
    assert {'repeatable_error', 'control_loop_area', 'feedback_loop_area'} < expected.keys()
    assert {metric.name: metric.value for metric in run_metrics(alone)} == pytest.approx(expected)
    assert [panel.name for panel in run_panels(alone)] == [panel.name for panel in run_panels(known)]


@pytest.mark.parametrize(
    ('topics', 'words'),
    [
        ((REFERENCE, CONTROL), 'no tracking error and no metrics based on it: the bag has no /head'),
        ((CONTROL,), 'no tracking error and no metrics based on it: the bag has no /head and no /reference'),
        ((REFERENCE, HEAD), 'no metrics of the command: the bag has no /control'),
    ],
)
def test_what_a_bag_lacks_is_told(titles, tmp_path, capsys, topics, words):
    write_constants(tmp_path / 'bag', dict.fromkeys(topics, 0.02))
    assert main([str(tmp_path / 'bag'), '--output', str(tmp_path / 'out')]) == 0
    assert f'bag: {words}' in capsys.readouterr().out.splitlines()
    assert words in yaml.safe_load((tmp_path / 'out' / 'metrics.yaml').read_text())['left_out']


def test_a_part_too_short_for_repeatable_parts_is_told(runs):
    assert left_out(Run.open(runs['nn'])) == []
    assert left_out(Run.open(runs['nn']), after=0.985) == [
        'no repeatable parts: the window has 0.0151 s, and '
        'periods of the reference that take an integer number of samples last 0.01 s'
    ]


def test_a_sweep_has_its_bode_plot(runs, tmp_path, capsys):
    assert main([str(runs['sweep']), '--output', str(tmp_path)]) == 0
    assert 'no measured response' not in capsys.readouterr().out
    measured = read_csv(runs['sweep'] / 'response.csv')
    curves = {
        figure['layout']['annotations'][0]['text']: figure
        for figure in figures((tmp_path / 'report.html').read_text('utf8'))
    }
    gain, phase, coherence = (curves[f'<b>Measured response: {name}</b>'] for name in ('gain', 'phase', 'coherence'))
    assert gain['layout']['xaxis']['type'] == 'log'
    assert 'type' not in gain['layout']['yaxis']
    np.testing.assert_allclose(gain['data'][0]['x'], measured.frequency, rtol=1e-6)
    np.testing.assert_allclose(10.0 ** (gain['data'][0]['y'] / 20.0), np.abs(measured.response), rtol=1e-5)
    turns = (phase['data'][0]['y'] - np.degrees(np.angle(measured.response))) / 360.0
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-5)
    np.testing.assert_allclose(coherence['data'][0]['y'], measured.coherence, rtol=1e-6)


def test_a_sweep_that_cannot_be_replayed_is_told(runs, titles, tmp_path, capsys):
    description = yaml.safe_load((runs['sweep'] / 'run.yaml').read_text())
    description['nodes']['/signal_analyzer']['parameters']['stop_frequency'] = 2500.0
    (tmp_path / 'bag').symlink_to(runs['sweep'] / 'bag')
    (tmp_path / 'run.yaml').write_text(yaml.safe_dump(description))
    assert main([str(tmp_path), '--output', str(tmp_path / 'out')]) == 0
    assert re.search(r': no measured response: /estimates has .* at the end, /ldv gives', capsys.readouterr().out)


def test_no_line_of_a_comparison_is_hidden_by_a_larger_one(tmp_path):
    """The small one is drawn last, also where it is large at the start."""
    time = np.linspace(0.0, 1.0, 2001)
    sign = np.where(np.arange(2001) % 2, 1.0, -1.0)
    small, large = np.where(time < 0.05, 20.0, 1.0) * sign, 5.0 * sign
    red, blue = Trace('small', time, small, '#ff0000'), Trace('large', time, large, '#0000ff')
    shares = {}
    for largest_first in (True, False):
        panel = Panel('error', 'Error', 's', 'nm', (red, blue), over_time=True, largest_first=largest_first)
        write_plot([panel], '', tmp_path / 'picture.png')
        red_, green, blue_ = np.moveaxis(matplotlib.image.imread(tmp_path / 'picture.png')[..., :3], -1, 0)
        shares[largest_first] = np.mean((red_ > 0.8) & (green < 0.3) & (blue_ < 0.3))
    assert shares[True] > 2.0 * shares[False]


@pytest.mark.parametrize('content', ['a: [', '- 1', 'controller: pid', b'\xff'])
def test_a_damaged_run_yaml_is_told(runs, tmp_path, capsys, content):
    (tmp_path / 'bag').symlink_to(runs['nn'] / 'bag')
    (tmp_path / 'run.yaml').write_bytes(content if isinstance(content, bytes) else content.encode())
    assert main([str(tmp_path)]) == 3
    assert re.match(
        rf'report: {tmp_path / "run.yaml"} (cannot be read|does not describe a run): ', capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['nowhere'], 'report: nowhere is neither a run folder nor a closed bag'),
        (['{nn}', '--after', '3'], 'no samples after 3.0 s: the run ends at 1 s'),
        (['{nn}', '{study}'], 'runs in different units cannot be compared'),
        (['{nn}', '--output', '{file}'], 'report: '),
        (['{head_alone}'], 'nothing to report: the bag has neither /control nor /reference with /head'),
    ],
)
def test_what_cannot_be_reported_is_told(runs, simulated, tmp_path, capsys, arguments, words):
    (tmp_path / 'file').write_text('')
    names = {**runs, 'file': tmp_path / 'file', 'head_alone': tmp_path / 'bag'}
    write_constants(names['head_alone'], {HEAD: 0.02})
    if '{study}' in arguments:
        names['study'] = simulated(tmp_path / 'study', '-p', 'duration:=0.1', '-p', 'length_unit:=m')
    assert main([argument.format(**names) for argument in arguments]) == 3
    assert words in capsys.readouterr().err


@pytest.mark.parametrize('after', ['-1', '-5', 'nan', 'inf'])
def test_a_time_that_is_none_is_rejected(runs, tmp_path, capsys, after):
    with pytest.raises(SystemExit) as ended:
        main([str(runs['nn']), '--output', str(tmp_path / 'out'), f'--after={after}'])
    assert ended.value.code == 2
    expected = f'report: argument --after: {after} is not a time; expected a finite number >= 0 [s]; see report --help'
    assert capsys.readouterr().err.splitlines()[-1] == expected
    assert not (tmp_path / 'out').exists()


def test_a_run_that_follows_nothing_has_no_error(runs, titles, tmp_path):
    open_loop, sweep = (Run.open(runs[name]) for name in ('open_loop', 'sweep'))
    control = {'peak_control', 'rms_control', 'control_variation'}
    areas = {'control_loop_area', 'feedback_loop_area'}
    assert {metric.name for metric in run_metrics(open_loop)} == control | areas
    assert {metric.name for metric in run_metrics(sweep)} == control
    assert [panel.name for panel in run_panels(open_loop)] == ['tracking', 'control', 'loop']
    assert len(run_panels(open_loop)[0].traces) == 1
    assert [panel.name for panel in run_panels(sweep)] == ['tracking', 'control', 'estimates']
    assert main([*map(str, (runs['open_loop'], runs['sweep'], runs['nn'])), '--output', str(tmp_path)]) == 0
    assert 'tracking error' not in summary(Run.open(runs['open_loop']), open_loop.description, tmp_path)


def test_the_picture_of_a_run_that_follows_nothing_shows_no_reference(runs, tmp_path, monkeypatch):
    drawn = []

    class Kept(Figure):
        def __init__(self, **options):
            super().__init__(**options)
            drawn.append(self)

    monkeypatch.setattr(plot, 'Figure', Kept)
    for name in ('nn', 'open_loop'):
        draw_run(Run.open(runs[name]), tmp_path / f'{name}.png')
    rows, rows_of_open_loop = ([axis.get_ylabel() for axis in figure.axes[::2]] for figure in drawn)
    assert rows[1] == 'error [nm]'
    for figure in drawn:
        # A legend wider than its plot would squeeze all plots of the figure.
        assert all(axis.get_position().width > 0.5 for axis in figure.axes[::2])
        for axis in figure.axes[::2]:
            legend = axis.get_legend()
            if legend is not None:
                assert legend.get_window_extent().width <= axis.get_window_extent().width
    assert rows_of_open_loop == [rows[0], rows[2]]  # and no estimates
    assert [line.get_label() for line in drawn[1].axes[0].lines] == ['head']


def test_metrics_of_a_square_wave(runs):
    found = {metric.name: metric for metric in run_metrics(Run.open(runs['square']))}
    # Eight edges of 25 ms; the one at the very end of the record has no answer.
    assert found['edges'].value == 8
    assert found['worst_steady_error'].value >= found['median_steady_error'].value > 0.0
    assert 'control_loop_area' not in found


def write_constants(path, values):
    """Write a bag of another recorder: topics with one value each."""
    writer = BagWriter(path, 'mcap', [(f'/x/{topic.name}', topic.type_name, 10) for topic in values], {})
    codec, ticks = VectorCodec('drive'), Ticks(1e-3)
    for tick in range(1000):
        for index, x in enumerate(values.values()):
            writer.write((index,), (10**9 + tick,), (codec.pack(ticks.stamp(tick), x, 0.0, 0.0),))
    writer.close()


def test_a_bag_of_another_recorder_with_two_topics(tmp_path):
    """Without run.yaml, without /control and /estimates: what can be reported is reported."""
    write_constants(tmp_path / 'bag', {REFERENCE: 0.0, HEAD: 0.02})
    run = Run.open(tmp_path / 'bag')
    found = {metric.name: metric.value for metric in run_metrics(run)}
    assert found['rms_error'] == pytest.approx(20.0)
    assert not {'peak_control', 'repeatable_error'} & found.keys()
    assert [panel.name for panel in run_panels(run)][:3] == ['tracking', 'error', 'spectrum']
    assert [panel.name for panel in comparison_panels([run, run])] == ['error', 'spectrum']
    assert main([str(tmp_path / 'bag'), '--output', str(tmp_path / 'out')]) == 0


@pytest.mark.parametrize(
    ('parameters', 'samples'),
    [
        ({'waveform': 'sine', 'frequency': 150.0}, 10_000 / 150.0),
        ({'waveform': 'multisine', 'frequency': 100.0, 'component_frequencies': [1.5, 2.0]}, 200.0),
        ({'waveform': 'chirp', 'frequency': 100.0}, None),
        ({'waveform': 'sine', 'frequency': 0.0}, None),
    ],
)
def test_period_of_the_reference(runs, parameters, samples):
    run = Run.open(runs['nn'])
    run.description['nodes']['/reference_generator']['parameters'].update(parameters)
    assert reference_period(run) == (samples if samples is None else pytest.approx(samples))


def test_every_text_in_a_page_is_inert(runs, tmp_path):
    """Also one that would end the script it is in, or begin another within it."""
    hostile = '<!--<script></script><img src=x onerror=alert(1)>'
    shutil.copytree(runs['pid'], tmp_path / 'run')
    description = yaml.safe_load((tmp_path / 'run' / 'run.yaml').read_text())
    description |= {'frame_id': hostile, 'length_unit': hostile, 'control_unit': hostile, 'reason': hostile}
    (tmp_path / 'run' / 'run.yaml').write_text(yaml.safe_dump(description))
    assert main([str(tmp_path / 'run')]) == 0
    page = (tmp_path / 'run' / 'report.html').read_text('utf8').replace(get_plotlyjs(), '')
    assert html.escape(hostile) in page
    for tag in ('<!--', '<img'):
        assert tag not in page
    assert (page.count('<script>'), page.count('</script>')) == (2, 2)
