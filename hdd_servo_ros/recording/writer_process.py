"""
A bag writer in a process of its own, fed through a pipe.

The loop's process hands over batches of bytes and goes on; the pipe's bounded buffer holds the loop back when the
writer is slower. When the loop's process dies, the pipe ends and the bag is closed all the same: a killed rig leaves a
readable bag.
"""

import contextlib
import dataclasses
import fcntl
import json
import os
import select
import signal
import struct
import subprocess
import sys
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from hdd_servo_ros.messages.errors import WriterError
from hdd_servo_ros.recording.bag_options import BagOptions
from hdd_servo_ros.recording.bag_writer import BagWriter

_BATCH = struct.Struct('<I')
_CLOSE = 0
_PIPE_SIZE = 2**19
"""Several batches, where the usual 64 KiB hold half of one: the loop would wait for this process at each [bytes]."""
BATCH_MESSAGES = 1024
_BATCH_TICKS = 256
"""Ticks that are handed over at once where a tick has few messages."""
STALL_TIMEOUT = 4.0
"""How long the pipe may stay full before the run fails [s]."""
OPEN_TIMEOUT = 60.0
"""How long the writer may take to start and to open the bag [s]."""
CLOSE_TIMEOUT = 60.0
"""How long the writer may take to write what it has and close the bag [s]."""


def launch_writer() -> 'subprocess.Popen[bytes]':
    """
    Start a process that can write a bag, for :class:`WriterProcess`: its imports then run beside those of the caller.

    It ends silently when its pipe is closed before a bag was opened.
    """
    return subprocess.Popen(
        [sys.executable, '-m', 'hdd_servo_ros.recording.writer_process'],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        # What a terminal sends to its foreground group, Ctrl-C or its closing, is for the loop's process alone.
        start_new_session=True,
    )


class WriterProcess:
    """
    The same interface as :class:`BagWriter`, in another process: ``process`` of :func:`launch_writer`, or a new one.

    Raises
    ------
    WriterError
        From any method, when the writing process has failed; carries its error text.
    """

    def __init__(
        self,
        path: Path,
        storage: str,
        topics: Sequence[tuple[str, str, int]],
        metadata: dict[str, str],
        options: BagOptions = BagOptions(),  # noqa: B008 - a frozen value
        process: 'subprocess.Popen[bytes] | None' = None,
    ) -> None:
        self._process = launch_writer() if process is None else process
        assert self._process.stdin is not None
        self._pipe = self._process.stdin
        os.set_blocking(self._pipe.fileno(), False)
        with contextlib.suppress(OSError):  # a user with many pipes may not have one more of this size
            fcntl.fcntl(self._pipe.fileno(), fcntl.F_SETPIPE_SZ, _PIPE_SIZE)
        self._topics: list[int] = []
        self._stamps: list[int] = []
        self._messages: list[bytes | memoryview] = []
        self._batch_messages = min(BATCH_MESSAGES, _BATCH_TICKS * len(topics))
        self._fault = ''
        opening = {
            'path': str(path),
            'storage': storage,
            'topics': list(topics),
            'metadata': metadata,
            'options': dataclasses.asdict(options),
        }
        self._send(json.dumps(opening).encode() + b'\n')
        answer = self._process.stdout
        assert answer is not None
        if not select.select((answer,), (), (), OPEN_TIMEOUT)[0]:
            self._process.kill()
            self._fault = f'the bag writer did not open the bag within {OPEN_TIMEOUT:g} s'
            raise WriterError(self._fault)
        if answer.readline() != b'open\n':
            self._raise()

    def write(self, topics: Sequence[int], stamps: Sequence[int], messages: Sequence[bytes | memoryview]) -> None:
        """Queue messages, and hand them over once there are enough for a batch."""
        # Lists, which take a tick's numbers sooner than arrays do.
        self._topics += topics
        self._stamps += stamps
        self._messages += messages
        if len(self._messages) >= self._batch_messages:
            self._hand_over()

    def flush(self) -> None:
        """Hand over what is queued: it survives the end of this process."""
        if self._messages:
            self._hand_over()

    def _hand_over(self) -> None:
        lengths = array('I', map(len, self._messages))
        self._send(
            b''.join(
                (
                    _BATCH.pack(len(lengths)),
                    bytes(self._topics),
                    array('q', self._stamps).tobytes(),
                    lengths.tobytes(),
                    *self._messages,
                )
            )
        )
        self._topics, self._stamps, self._messages = [], [], []

    def _send(self, data: bytes) -> None:
        descriptor = self._pipe.fileno()
        left = memoryview(data)
        while left:
            # A full pipe holds the loop back, but not for ever: a disk may hang, and nothing else here would end it.
            _, writable, _ = select.select((), (descriptor,), (), STALL_TIMEOUT)
            if not writable:
                self._process.kill()
                self._fault = f'the bag writer took nothing for {STALL_TIMEOUT:g} s'
                raise WriterError(self._fault)
            try:
                left = left[os.write(descriptor, left) :]
            except BlockingIOError:
                continue
            except BrokenPipeError:
                self._raise()

    def _raise(self) -> None:
        assert self._process.stderr is not None
        text = self._process.stderr.read().decode(errors='replace').strip()
        self._process.wait()
        self._fault = text.splitlines()[-1] if text else f'the bag writer ended with {self._process.returncode}'
        raise WriterError(self._fault)

    def close(self) -> None:
        """Hand over what is queued, and wait until the bag is complete; what has failed before fails again."""
        if self._fault:
            raise WriterError(self._fault)
        if self._messages:
            self._hand_over()
        self._send(_BATCH.pack(_CLOSE))
        self._pipe.close()
        self._process.stdin = None
        try:
            _, text = self._process.communicate(timeout=CLOSE_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            raise WriterError(f'the bag writer did not close the bag within {CLOSE_TIMEOUT:g} s') from None
        if self._process.returncode != 0:
            lines = text.decode(errors='replace').strip().splitlines()
            raise WriterError(lines[-1] if lines else f'the bag writer ended with {self._process.returncode}')


def _write_batches(pipe: BinaryIO, writer: BagWriter) -> bool:
    """Write batches until the closing mark (return True) or until the pipe ends without one (return False)."""
    while True:
        head = pipe.read(_BATCH.size)
        if len(head) < _BATCH.size:
            return False
        (count,) = _BATCH.unpack(head)
        if count == _CLOSE:
            return True
        kinds = (np.uint8, np.int64, np.uint32)
        topics, stamps, sizes = (np.frombuffer(pipe.read(count * np.dtype(kind).itemsize), kind) for kind in kinds)
        size = int(sizes.sum())
        payloads = memoryview(pipe.read(size))
        if len(payloads) < size:
            return False
        writer.write_batch(topics, stamps, sizes, payloads)


def main() -> int:
    """Read the opening line and the batches from standard input; the exit code is 0 for a properly closed bag."""
    # Ctrl-C reaches the whole foreground group; this process ends with its pipe, after everything is written.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    pipe = sys.stdin.buffer
    line = pipe.readline()
    if not line:  # the run never began
        return 2
    opening = json.loads(line)
    try:
        options = BagOptions(**opening['options'])
        writer = BagWriter(Path(opening['path']), opening['storage'], opening['topics'], opening['metadata'], options)
        sys.stdout.write('open\n')
        sys.stdout.flush()
        try:
            closed = _write_batches(pipe, writer)
        finally:
            writer.close()
    except OSError as error:
        sys.stderr.write(f'{error.filename or opening["path"]}: {error.strerror or error}\n')
        return 1
    except Exception as error:
        sys.stderr.write(f'{type(error).__name__}: {error}\n')
        return 1
    return 0 if closed else 2


if __name__ == '__main__':
    sys.exit(main())
