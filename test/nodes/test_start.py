"""Imports of the nodes at startup, which cost time in each process of a run."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
NODES = sorted(
    path.stem for path in (ROOT / 'hdd_servo_ros' / 'nodes').glob('*.py') if 'def main(' in path.read_text('utf8')
)
LATER = ('scipy.signal', 'scipy.optimize', 'matplotlib', 'pandas', 'plotly')
"""Modules for certificates, identification and plots, which are used after a run or by other commands."""


def test_no_node_imports_modules_that_it_may_not_need():
    assert {'rig', 'vcm_plant', 'adaptive_nn_controller', 'signal_analyzer'} <= set(NODES)
    imports = '; '.join(f'import hdd_servo_ros.nodes.{node}' for node in NODES)
    code = f'{imports}; import sys; print(*sorted({{*{LATER!r}}} & set(sys.modules)))'
    answer = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, timeout=250)
    assert (answer.returncode, answer.stdout.strip()) == (0, ''), answer.stderr
