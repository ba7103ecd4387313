"""The tables of complete campaigns in ``docs/reliability.md``."""

import datetime as dt
import os
import platform
import re
from collections.abc import Sequence
from pathlib import Path

from faults.campaign import Result
from faults.processes import ROOT

DOCUMENT = ROOT / 'docs' / 'reliability.md'
_MARK = '<!-- Below: written by `make faults`. -->\n'
DURATIONS = (
    'A campaign that exceeds its time limit ends, and reports the number of its trials. docs/reliability.md lists the\n'
    'durations of complete campaigns. long_run records one hour and needs 20 GB of disk space.'
)


def write(result: Result, titles: Sequence[str], document: Path = DOCUMENT) -> None:
    """
    Write the table of a complete campaign into the document, replacing the previous one.

    Parameters
    ----------
    result
        Results of the campaign.
    titles
        Titles of all campaigns, in the order of the document.
    document
        The document.
    """
    introduction, _, tables = document.read_text('utf8').partition(_MARK)
    sections = {part.splitlines()[0]: part.rstrip() for part in re.split('^## ', tables, flags=re.MULTILINE)[1:]}
    where = f'{dt.date.today()}, {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}'
    lines = '\n'.join(result.lines()).removeprefix('## ').rstrip()
    sections[result.campaign.title] = f'{lines}\n\n{where}.'
    written = '\n\n'.join(f'## {sections[title]}' for title in titles if title in sections)
    document.write_text(f'{introduction}{_MARK}\n{written}\n', 'utf8')
