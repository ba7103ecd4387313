"""Where ROS writes its logs: elsewhere if it cannot write where it would, for without a log it does not start."""

import os
import tempfile
from collections.abc import MutableMapping
from pathlib import Path


def find_log_folder(environment: MutableMapping[str, str]) -> None:
    """
    Have ROS log into a folder for temporary files if there is no home directory that it can write to.

    Parameters
    ----------
    environment
        Environment variables of this process, changed. They stay as they are if they name a folder.
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
