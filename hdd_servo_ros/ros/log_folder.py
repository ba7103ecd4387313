"""Log directory of ROS: a temporary one if the default is not writable, because ROS does not start without a log."""

import os
import tempfile
from collections.abc import MutableMapping
from pathlib import Path


def find_log_folder(environment: MutableMapping[str, str]) -> None:
    """
    Let ROS write its log to a temporary directory if it cannot write to the home directory.

    Parameters
    ----------
    environment
        Environment variables of this process, modified in place unless they already name a log directory.
    """
    if environment.get('ROS_LOG_DIR') or environment.get('ROS_HOME'):
        return
    home = environment.get('HOME')
    if home:
        folder = Path(home) / '.ros' / 'log'
        existing = next(path for path in (folder, *folder.parents) if path.exists())
        if existing.is_dir() and os.access(existing, os.W_OK):
            return
    environment['ROS_LOG_DIR'] = str(Path(tempfile.gettempdir()) / f'ros-log-{os.getuid()}')
