"""The options of an executable: what is wrong with them is told in one line, as every other error is."""

import argparse
from typing import NoReturn

from hdd_servo_ros.messages.exit_codes import WRONG_ARGUMENTS, one_line


class CommandParser(argparse.ArgumentParser):
    """A parser whose errors are one line with a hint at ``--help``, without the usage before them."""

    def error(self, message: str) -> NoReturn:
        """End the command with exit code 2."""
        self.exit(WRONG_ARGUMENTS, f'{self.prog}: {one_line(ValueError(message))}; {self.prog} --help tells more\n')
