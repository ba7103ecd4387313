"""One publisher per topic among the processes of a machine."""

import contextlib
import os
import subprocess
import sys

import pytest

from hdd_servo_ros.ros.topic_claims import ClaimError, TopicClaims

DOMAIN = 200 + os.getpid() % 30
HOLDER = (
    'import sys; from hdd_servo_ros.ros.topic_claims import TopicClaims; '
    'claims = TopicClaims(sys.argv[2:], int(sys.argv[1])); print("held", flush=True); sys.stdin.read()'
)


def test_a_topic_is_claimed_once_until_it_is_released():
    with contextlib.closing(TopicClaims(['/a', '/b'], DOMAIN)):
        with pytest.raises(ClaimError, match=f'/b is published by process {os.getpid()} already'):
            TopicClaims(['/c', '/b'], DOMAIN)
        TopicClaims(['/c'], DOMAIN).close()
        TopicClaims(['/bench2/b'], DOMAIN).close()
        TopicClaims(['/b'], DOMAIN + 1).close()
    TopicClaims(['/a', '/b'], DOMAIN).close()


def test_a_killed_process_holds_no_claim():
    command = [sys.executable, '-c', HOLDER, str(DOMAIN), '/x' * 200]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == 'held\n'
        with pytest.raises(ClaimError, match=f'by process {process.pid} already'):
            TopicClaims(['/x' * 200], DOMAIN)
        process.kill()
        process.wait()
    TopicClaims(['/x' * 200], DOMAIN).close()
