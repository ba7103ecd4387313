"""The code in docs/bag-assertions.md runs as it stands there, and passes."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]

pytest_plugins = ['pytester']


def test_the_tutorial(pytester, run_pytest):
    text = (ROOT / 'docs' / 'bag-assertions.md').read_text('utf8')
    blocks = re.findall(r'```python\n(.*?)```', text, re.DOTALL)
    assert len(blocks) == 3
    (pytester.path / 'params').symlink_to(ROOT / 'params')
    pytester.makepyfile('\n'.join(blocks))
    run_pytest().assert_outcomes(passed=5)
