"""A kernel that was loaded from the cache runs, and is inlined into others that are compiled afterward."""

import json
import os
import subprocess
import sys

import pytest

CODE = """
import json, sys
import llvmlite.binding as llvm
import numba
from hdd_servo_ros.numerics import compiled

parsed = []
parse = llvm.parse_bitcode
llvm.parse_bitcode = lambda code: parsed.append(len(code)) or parse(code)


@compiled.compiled
def inner(x: float) -> float:
    return 3.0 * x + 1.0


@compiled.compiled
def outer(x: float) -> float:
    return inner(x) * inner(x + 1.0)


@numba.njit
def foreign(x):
    return outer(x) - inner(x)


values = [outer(2.0), inner(2.0)]
before = max(parsed, default=0)
if 'link' in sys.argv:
    values.append(foreign(2.0))
(loaded,) = outer.overloads.values()
module = loaded.library._get_module_for_linking()
names = [found.name for found in module.functions if not found.is_declaration]
print(json.dumps([values, before, names, len(module.as_bitcode()), bool(outer.stats.cache_hits)]))
"""


@pytest.fixture
def run(tmp_path):
    (tmp_path / 'kernels.py').write_text(CODE)

    def run(*arguments):
        ended = subprocess.run(
            [sys.executable, str(tmp_path / 'kernels.py'), *arguments],
            cwd=tmp_path,
            env={**os.environ, 'XDG_CACHE_HOME': str(tmp_path / 'cache')},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert ended.returncode == 0, ended.stderr
        return json.loads(ended.stdout)

    return run


def test_a_loaded_kernel_runs_without_its_llvm_code_and_is_linked_with_it(run):
    compiled_values, _, compiled_names, compiled_size, was_loaded = run('link')
    assert not was_loaded
    assert compiled_values == [70.0, 7.0, 63.0]

    for words in ((), ('link',)):
        values, parsed, names, size, was_loaded = run(*words)
        assert was_loaded
        assert values == compiled_values[: len(values)]
        # Only outlines were parsed for loading; the complete code is linked.
        assert 0 < parsed < size
        assert (names, size) == (compiled_names, compiled_size)
