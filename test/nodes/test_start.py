"""What the nodes import before they can begin; each process of a run pays for it."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
NODES = sorted(
    path.stem for path in (ROOT / 'hdd_servo_ros' / 'nodes').glob('*.py') if 'def main(' in path.read_text('utf8')
)
LATER = ('scipy.signal', 'scipy.optimize', 'matplotlib', 'pandas', 'plotly')
"""For certificates, identification and pictures, which come after the run or beside it."""


def test_no_node_waits_for_what_it_may_never_need():
    assert {'rig', 'vcm_plant', 'adaptive_nn_controller', 'signal_analyzer'} <= set(NODES)
    imports = '; '.join(f'import hdd_servo_ros.nodes.{node}' for node in NODES)
    code = f'{imports}; import sys; print(*sorted({{*{LATER!r}}} & set(sys.modules)))'
    answer = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, timeout=250)
    assert (answer.returncode, answer.stdout.strip()) == (0, ''), answer.stderr
