"""A short part of each campaign of faults, and the frame itself."""

import random
import time

import pytest

from faults import campaign
from faults.__main__ import CAMPAIGNS
from faults.campaign import HANG, ORPHAN, TRACEBACK, WRONG, Campaign, Fault, Trial
from faults.files import damage, originals
from faults.judging import call, false_claims
from faults.processes import processes


@pytest.mark.parametrize('name', CAMPAIGNS)
def test_a_short_part_has_no_fault(name, tmp_path):
    chosen = CAMPAIGNS[name]
    result = campaign.run(chosen, tmp_path, chosen.short)
    assert result.trials == chosen.short
    assert result.faults == []


def test_a_trial_is_made_again_by_its_number_and_its_faults_are_kept(tmp_path):
    def trial(folder, choice):
        number = choice.randrange(1000)
        (folder / 'left').write_text(str(number))
        return Trial('odd' if number % 2 else 'even', [Fault(WRONG, str(number))] if number % 2 else [])

    made = Campaign('made', 'Made', 20, 5, 60.0, trial)
    whole = campaign.run(made, tmp_path / 'whole', 20)
    assert whole.outcomes['odd'] == whole.count(WRONG) == len(list((tmp_path / 'whole').iterdir())) > 0
    number, fault = whole.faults[-1]
    again = campaign.run(made, tmp_path / 'again', 1, first=number)
    assert again.faults == [(number, fault)]
    assert f'| wrong verdicts | {whole.count(WRONG)} |' in list(whole.lines())


def test_a_campaign_is_bounded_in_time(tmp_path):
    def trial(folder, choice):
        time.sleep(0.02)
        return Trial('slept')

    assert campaign.run(Campaign('slow', 'Slow', 1000, 1, 0.1, trial), tmp_path, 1000).trials < 20


def test_what_a_call_does_wrong_is_seen(monkeypatch):
    monkeypatch.setattr('faults.judging.LONGEST_CALL', 0.1)

    def never_returns():
        while True:
            time.sleep(0.01)

    def prints_a_traceback():
        print('Traceback (most recent call last)\nKeyError: x')
        return 0

    assert [fault.kind for fault in call(never_returns)[2]] == [HANG]
    assert [fault.kind for fault in call(lambda: 1 / 0)[2]] == [TRACEBACK]
    assert [fault.kind for fault in call(prints_a_traceback)[2]] == [TRACEBACK]
    assert call(lambda: 2) == (2, '', [])


def test_an_orphan_and_a_hang_are_seen(tmp_path):
    import subprocess
    import sys

    with processes(tmp_path) as made:
        sleeper = [sys.executable, '-c', 'import time; time.sleep(100)']
        child = subprocess.Popen(sleeper, env=made.environment)
        assert [fault.kind for fault in made.ended(0.5)] == [ORPHAN]
        made.started['sleeper'] = child
        (tmp_path / 'sleeper.log').write_text('')
        assert [fault.kind for fault in made.ended(0.5)] == [HANG]
    assert child.poll() is not None


def test_a_false_claim_is_seen(tmp_path, simulated):
    run = simulated(tmp_path / 'run', '-p', 'duration:=0.01', '-p', 'plot:=false')
    assert list(false_claims(run, 0, None)) == []
    assert [fault.kind for fault in false_claims(run, 1, None)] == [WRONG]
    other = simulated(tmp_path / 'other', '-p', 'duration:=0.01', '-p', 'amplitude:=3.0', '-p', 'plot:=false')
    from hdd_servo_ros import Run

    assert {fault.kind for fault in false_claims(run, 0, Run.open(other))} == {WRONG}
    text = (run / 'run.yaml').read_text()
    (run / 'run.yaml').write_text(text.replace('last_tick: 100', 'last_tick: 99'))
    (fault,) = false_claims(run, 0, None)
    assert 'run.yaml says 99 for the last tick, the bag holds 100' in fault.seen


def test_a_file_is_damaged_as_the_seed_says(tmp_path):
    original = originals()['mcap'] / 'bag' / 'bag.mcap'
    for number in range(20):
        contents = []
        for name in ('one', 'two'):
            path = tmp_path / name
            path.write_bytes(original.read_bytes())
            damage(path, random.Random(number))
            contents.append(path.read_bytes() if path.exists() else None)
        assert contents[0] == contents[1]
