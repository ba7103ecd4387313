"""The tables of whole campaigns in ``docs/reliability.md``."""

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
HOW_LONG = (
    'A campaign whose time is over ends with the trials that it has made, and says how many. docs/reliability.md has\n'
    'the durations of whole ones. The hour of long_run needs 20 GB on the disk.'
)


def write(result: Result, titles: Sequence[str], document: Path = DOCUMENT) -> None:
    """
    Put the table of a whole campaign into the document, in place of the one that was there.

    Parameters
    ----------
    result
        What the campaign has shown.
    titles
        Of all campaigns, in the order of the document.
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
