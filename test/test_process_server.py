"""A copy of the prepared process runs a program as a new interpreter does."""

import signal
import sys

import pytest

PROGRAM = """
import json, os, signal, sys
from hdd_servo_ros.version import __version__
print(json.dumps([__name__, sys.argv, sys.path[0], os.getcwd(), sorted(os.environ.items()), sys.stdin.read()]))
print([signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGCHLD)])
print('an error', file=sys.stderr)
"""
# Of whoever runs the tests in the background SIGINT is ignored.
PROGRAM_THAT_WAITS = """
import signal, time
signal.signal(signal.SIGINT, signal.default_int_handler)
print('here', flush=True)
time.sleep(600)
"""
ENDS = {
    'falls off': '',
    'none': 'sys.exit()',
    'number': 'sys.exit(3)',
    'text': "sys.exit('a reason')",
    'error': 'raise ValueError(3)',
}


@pytest.fixture
def new(bench, monkeypatch, tmp_path):
    """Give a bench of the same folder and domain whose processes are new interpreters."""
    made = type(bench)(tmp_path, None)
    made.environment = bench.environment
    yield made
    made.end()


@pytest.mark.parametrize('how', [('program.py',), ('-m', 'program')])
@pytest.mark.parametrize('end', ENDS)
def test_the_same_as_in_a_new_interpreter(bench, new, how, end):
    (bench.directory / 'program.py').write_text(PROGRAM + ENDS[end])
    copied, expected = (starts.python(*how, 'an argument', '--option') for starts in (bench, new))
    assert copied.returncode == expected.returncode
    assert copied.stdout == expected.stdout
    assert [copied.stderr.splitlines()[index] for index in (0, -1)] == [
        expected.stderr.splitlines()[index] for index in (0, -1)
    ]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_signals_end_a_copy(bench, number):
    (bench.directory / 'program.py').write_text(PROGRAM_THAT_WAITS)
    process = bench.start_python('program', 'program.py')
    process.wait_for('here')
    process.signal(number)
    assert process.wait() == -number


def test_what_takes_a_new_interpreter(bench):
    (bench.directory / 'program.py').write_text('import sys\nprint(len(sys.modules))')
    copied = int(bench.python('program.py').stdout)
    bench.environment['PYTHONPATH'] += ':elsewhere'
    assert int(bench.python('program.py').stdout) < copied / 4
    assert bench.python('-c', 'import sys; print(len(sys.modules))').stdout.strip().isdigit()
    assert 'numba' in sys.modules
