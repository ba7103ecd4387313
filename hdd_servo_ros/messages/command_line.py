"""Command line parser whose errors are a single line, as all other errors of the executables."""

import argparse
from typing import NoReturn

from hdd_servo_ros.messages.exit_codes import WRONG_ARGUMENTS, one_line


class CommandParser(argparse.ArgumentParser):
    """Argument parser with one-line errors and a hint at ``--help``, without the usage text."""

    def error(self, message: str) -> NoReturn:
        """Exit with code 2."""
        self.exit(WRONG_ARGUMENTS, f'{self.prog}: {one_line(ValueError(message))}; see {self.prog} --help\n')
