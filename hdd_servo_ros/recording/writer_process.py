"""
Bag writer in a separate process, fed through a pipe.

The process of the loop hands over batches of bytes and continues. The bounded buffer of the pipe blocks the loop if the
writer is slower. If the process of the loop dies, the pipe ends and the bag is still closed, so a killed rig leaves a
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
"""Pipe size for several batches [bytes]; the default of 64 KiB is half a batch and would block the loop each time."""
BATCH_MESSAGES = 1024
_BATCH_TICKS = 256
"""Largest number of ticks per batch, which limits a batch if a tick has few messages."""
STALL_TIMEOUT = 4.0
"""Time for which the pipe may stay full before the run fails [s]."""
OPEN_TIMEOUT = 60.0
"""Time limit for starting the writer and opening the bag [s]."""
CLOSE_TIMEOUT = 60.0
"""Time limit for writing the remaining messages and closing the bag [s]."""


def launch_writer() -> 'subprocess.Popen[bytes]':
    """
    Start a writer process for :class:`WriterProcess`, so that its imports run in parallel to those of the caller.

    The process exits silently if its pipe is closed before a bag is opened.
    """
    return subprocess.Popen(
        [sys.executable, '-m', 'hdd_servo_ros.recording.writer_process'],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        # Only the process of the loop shall receive the signals of a terminal (Ctrl-C, closing).
        start_new_session=True,
    )


class WriterProcess:
    """
    Interface of :class:`BagWriter` to a writer in another process: ``process`` of :func:`launch_writer`, or a new one.

    Raises
    ------
    WriterError
        From any method, if the writing process has failed; the text is its error message.
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
        with contextlib.suppress(OSError):  # a user with many pipes may have exceeded the limit
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
        replies = self._process.stdout
        assert replies is not None
        if not select.select((replies,), (), (), OPEN_TIMEOUT)[0]:
            self._process.kill()
            self._fault = f'the bag writer did not open the bag within {OPEN_TIMEOUT:g} s'
            raise WriterError(self._fault)
        if replies.readline() != b'open\n':
            self._raise()

    def write(self, topics: Sequence[int], stamps: Sequence[int], messages: Sequence[bytes | memoryview]) -> None:
        """Queue messages, and hand them over once there are enough for a batch."""
        # For the few numbers of a tick, lists are faster than arrays.
        self._topics += topics
        self._stamps += stamps
        self._messages += messages
        if len(self._messages) >= self._batch_messages:
            self._hand_over()

    def flush(self) -> None:
        """Hand over all queued messages, so that they survive the end of this process."""
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
            # A full pipe blocks the loop only for a limited time, because the disk may hang.
            _, writable, _ = select.select((), (descriptor,), (), STALL_TIMEOUT)
            if not writable:
                self._process.kill()
                self._fault = f'the bag writer accepted no data for {STALL_TIMEOUT:g} s'
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
        """Hand over all queued messages and wait until the bag is closed; raise an earlier failure again."""
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
    """Write batches; return True at the closing mark, False if the pipe ends without it."""
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
    """Read the opening line and the batches from standard input; return 0 for a properly closed bag."""
    # Ctrl-C reaches the whole foreground group. This process exits when its pipe ends and all data are written.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    pipe = sys.stdin.buffer
    line = pipe.readline()
    if not line:  # the run was never started
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
