import collections
import fcntl
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba.core.errors import NumbaError

from hdd_servo_ros.numerics import kernel_cache
from hdd_servo_ros.numerics.compiled import compiled
from hdd_servo_ros.numerics.kernel_folder import PACKAGE

kernel: Any = compiled
"""Return the cache without the type of the compiled function."""

CALL = """
import json, os, sys, time
from numba.core import event
from hdd_servo_ros.numerics import elementary, kernel_cache

kernel_cache._NOTICE_AFTER = 0.1


class Compiled(event.Listener):
    signatures = []

    def on_start(self, event):
        name = event.data['dispatcher'].py_func.__name__
        self.signatures.append((name, str(event.data['args'])))
        if 'stop in ' + name in sys.argv:
            print('stopped', flush=True)
            time.sleep(600.0)

    def on_end(self, event):
        pass


event.register('numba:compile', Compiled())
while 'wait' in sys.argv and not os.path.exists('go'):
    time.sleep(0.001)
values = elementary.exp(1.0), elementary.log(2.0), *elementary.sine_cosine_of_turns(0.3)
own = {name for name, kernel in vars(elementary).items() if hasattr(kernel, 'py_func')}
print(json.dumps([values, [' of '.join(signature) for signature in Compiled.signatures if signature[0] in own]]))
"""
"""Call three kernels that call others; print their values and the compiled kernels with their argument types."""

CALLED = {'exp of (float64,)', 'log of (float64,)', 'sine_cosine_of_turns of (float64,)'}


class Starter:
    """Starts processes on a copy of the package, all with one cache."""

    def __init__(self, directory):
        self.directory = directory
        self.processes = []

    def copy(self, name):
        shutil.copytree(PACKAGE, self.directory / name / 'hdd_servo_ros', ignore=shutil.ignore_patterns('__pycache__'))
        return self.directory / name

    def start(self, directory, *arguments):
        environment = {**os.environ, 'XDG_CACHE_HOME': str(self.directory / 'cache'), 'PYTHONPATH': str(directory)}
        process = subprocess.Popen(
            [sys.executable, '-c', CALL, *arguments],
            cwd=self.directory,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.processes.append(process)
        return process

    def cached(self):
        """Return the compiled kernels on disk and when each was written."""
        return {path.name: path.stat().st_mtime_ns for path in (self.directory / 'cache').rglob('*.nb?')}


@pytest.fixture
def starter(tmp_path):
    made = Starter(tmp_path)
    yield made
    for process in made.processes:
        process.kill()
        process.communicate()


def result(process):
    """Return the computed values and the compiled kernels of a process, and its other output."""
    output, errors = process.communicate(timeout=200)
    assert process.returncode == 0, errors
    values, names = json.loads(output)
    return values, names, errors


def test_copies_of_the_package_share_compiled_kernels(starter):
    values, names, _ = result(starter.start(starter.copy('here')))
    assert set(names) >= CALLED
    before = starter.cached()
    other = starter.copy('there')
    assert result(starter.start(other)) == (values, [], '')
    assert starter.cached() == before
    # A change of any of the sources counts: not of the time of a file, which differs between copies anyway.
    changed = other / 'hdd_servo_ros' / 'drive' / 'electrical.py'
    changed.write_text(changed.read_text() + '\n')
    assert sorted(result(starter.start(other))[1]) == sorted(names)


def test_processes_that_start_at_once_compile_each_kernel_once(starter):
    processes = [starter.start(PACKAGE.parent, 'wait') for _ in range(4)]
    (starter.directory / 'go').touch()
    results = [result(process) for process in processes]
    counts = collections.Counter(name for _, names, _ in results for name in names)
    assert counts.keys() >= CALLED
    assert set(counts.values()) == {1}
    assert len({tuple(values) for values, _, _ in results}) == 1


def test_a_killed_compiler_leaves_the_kernel_to_the_one_that_waits(starter):
    compiler = starter.start(PACKAGE.parent, 'stop in exp')
    assert compiler.stdout.readline() == 'stopped\n'
    waiting = [starter.start(PACKAGE.parent) for _ in range(2)]
    # They print a notice and wait.
    messages = [process.stderr.readline() for process in waiting]
    assert all(kernel_cache.WAITING in line for line in messages), messages
    assert all(process.poll() is None for process in waiting)
    compiler.kill()
    results = [result(process) for process in waiting]
    assert sum(names.count('exp of (float64,)') for _, names, _ in results) == 1
    assert results[0][0] == results[1][0]


def lock_of(function):
    """Return an open lock file of a kernel, as another process would have it."""
    return Path(function._cache._lock_file).open('w')


def test_a_kernel_that_does_not_compile_leaves_no_lock():
    @kernel
    def wrong(value):
        return value.there_is_no_such_thing

    with pytest.raises(NumbaError):
        wrong(1.0)
    with lock_of(wrong) as other:
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_patience_with_a_stopped_compiler_ends(monkeypatch, capsys):
    @kernel
    def shifted(value):
        return value + 1.0

    # Or an earlier run of this test would have compiled it.
    shifted._cache.disable()
    monkeypatch.setattr(kernel_cache, '_PATIENCE', 0.05)
    monkeypatch.setattr(kernel_cache, '_NOTICE_AFTER', 0.0)
    monkeypatch.setattr(kernel_cache.KernelCache, '_noticed', False)
    with lock_of(shifted) as other:
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        assert shifted(1.0) == 2.0
    assert capsys.readouterr().err.count(kernel_cache.WAITING) == 1


def test_a_kernel_compiles_where_no_lock_can_be_had(monkeypatch):
    @kernel
    def scaled(value):
        return 3.0 * value

    scaled._cache.disable()
    monkeypatch.setattr(scaled._cache, '_lock_file', Path('/nowhere/at/all'))
    assert scaled(2.0) == 6.0


@pytest.mark.parametrize('suffix', ['nbi', 'nbc'])
@pytest.mark.parametrize('damage', [b'', b'\x80\x04', b'not what Numba wrote'])
def test_damaged_files_are_compiled_anew(starter, suffix, damage):
    values, _, _ = result(starter.start(PACKAGE.parent))
    for path in (starter.directory / 'cache').rglob(f'*exp*.{suffix}'):
        path.write_bytes(damage)
    again, compiled_again, errors = result(starter.start(PACKAGE.parent))
    assert again == values
    assert any(name.startswith('exp of') for name in compiled_again)
    assert 'Traceback' not in errors
    assert result(starter.start(PACKAGE.parent))[1] == []
