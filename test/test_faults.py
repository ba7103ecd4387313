"""A few trials of each fault campaign, and the campaign runner."""

import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

from faults import campaign, disk_full, parameter_services, tables
from faults.__main__ import CAMPAIGNS, main
from faults.campaign import HANG, NOT_FINITE, ORPHAN, TRACEBACK, WRONG, Campaign, Fault, Trial
from faults.files import damage, originals
from faults.judging import call, false_claims
from faults.processes import processes
from faults.workers import parallel

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize('name', [name for name in CAMPAIGNS if CAMPAIGNS[name].short])
def test_the_first_trials_find_no_fault(name, tmp_path, monkeypatch):
    if name == 'disk_full' and (why := disk_full.cannot_make()):
        pytest.skip(why)
    monkeypatch.setattr(parameter_services, 'SETS', 30)
    chosen = CAMPAIGNS[name]
    result = campaign.run(chosen, tmp_path, chosen.short)
    assert result.trials == chosen.short
    assert result.faults == []


def test_a_short_recording_by_simulate_and_rig(tmp_path):
    """Runs of 2^17 ticks or more are read in pieces; complete arrays of this one would take 300 MB."""
    # In a separate process, because the memory of a child starts from that of its parent.
    program = (
        'import pathlib, sys; from faults.long_run import recorded; '
        'trial = recorded(pathlib.Path(sys.argv[1]), 140_000, 0); print(trial); sys.exit(bool(trial.faults))'
    )
    command = [sys.executable, '-c', program, str(tmp_path)]
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join([str(ROOT), os.environ.get('PYTHONPATH', '')])}
    ran = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=900.0)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    for name in ('simulate', 'report', 'recover', 'replay'):
        assert f'memory of long {name} [MB]' in ran.stdout


def test_the_campaigns_have_the_documented_numbers_of_trials():
    trials = {name: chosen.trials for name, chosen in CAMPAIGNS.items()}
    assert (trials['kills'], trials['messages'], trials['files'], trials['disk_full']) == (300, 200, 2000, 30)
    # A request sets one to three parameters.
    assert trials['parameters'] + trials['services'] * parameter_services.SETS >= 20_000
    assert all(f'`{name}`' in tables.DOCUMENT.read_text('utf8') for name in CAMPAIGNS)


def test_a_trial_is_repeated_by_its_number_and_its_faults_are_kept(tmp_path):
    def trial(folder, choice):
        number = choice.randrange(1000)
        (folder / 'left').write_text(str(number))
        return Trial('odd' if number % 2 else 'even', [Fault(WRONG, str(number))] if number % 2 else [])

    example = Campaign('example', 'Example', 20, 5, 60.0, trial)
    whole = campaign.run(example, tmp_path / 'whole', 20)
    assert whole.outcomes['odd'] == whole.count(WRONG) == len(list((tmp_path / 'whole').iterdir())) > 0
    number, fault = whole.faults[-1]
    again = campaign.run(example, tmp_path / 'again', 1, first=number)
    assert again.faults == [(number, fault)]
    assert f'| wrong verdicts | {whole.count(WRONG)} |' in list(whole.lines())


@pytest.mark.parametrize('runner', [campaign.sequential, parallel(2)])
def test_a_campaign_is_bounded_in_time_and_logs_its_progress(runner, tmp_path, monkeypatch):
    def trial(folder, choice):
        time.sleep(0.02)
        return Trial('slept', counts={'naps': 2}, figures={'length [s]': choice.random()})

    monkeypatch.setattr(campaign, 'PROGRESS_INTERVAL', 0.05)
    lines: list[str] = []
    bounded = Campaign('slow', 'Slow', 1000, 1, 0.3, trial)
    result = campaign.run(bounded, tmp_path, 1000, log=lines.append, runner=runner)
    assert 0 < result.trials < 100
    assert lines[0].startswith('slow: ')
    assert 'trials, 0 faults, about 0.0 min left' in lines[0]
    assert result.counts['naps'] == 2 * result.trials
    largest = max(random.Random(f'slow {number}').random() for number in range(result.trials))
    assert result.figures == {'length [s]': largest}
    assert f'{result.trials} of 1000 trials' in '\n'.join(result.lines())


def test_parallel_trials_equal_sequential_trials(tmp_path):
    def trial(folder, choice):
        return Trial(str(choice.randrange(4)))

    example = Campaign('example', 'Example', 40, 5, 60.0, trial)
    alone = campaign.run(example, tmp_path / 'alone', 40)
    assert campaign.run(example, tmp_path / 'together', 40, runner=parallel(2)).outcomes == alone.outcomes


def test_a_trial_that_does_not_return_or_whose_process_ends_is_a_fault_and_the_others_continue(tmp_path):
    def trial(folder, choice):
        what = folder.name.partition('-')[2]
        if what == '1':
            os._exit(1)
        if what == '2':
            subprocess.Popen(['sleep', '1000'])
            time.sleep(1000.0)
        return Trial(str(1 / (what != '3')))

    example = Campaign('example', 'Example', 6, 1, 60.0, trial, trial_seconds=1.0)
    result = campaign.run(example, tmp_path, 6, runner=parallel(2))
    assert result.outcomes == {'1.0': 3, 'did not return': 2, 'not checked': 1}
    faults = dict(result.faults)
    assert (faults[1].kind, faults[2].kind, faults[3].kind) == (WRONG, HANG, WRONG)
    assert 'ZeroDivisionError' in faults[3].message


def test_the_tables_of_other_campaigns_are_kept(tmp_path, monkeypatch):
    document = tmp_path / 'reliability.md'
    document.write_text('# Reliability\n\n<!-- Below: written by `make faults`. -->\n\n## B\n\nof b\n\n## C\n\nold\n')
    result = campaign.Result(Campaign('c', 'C', 3, 1, 1.0, lambda folder, choice: Trial('')))
    result.add(0, Trial('ends', [Fault(NOT_FINITE, '/head')], figures={'lost [s]': 0.25}))
    tables.write(result, ['A', 'B', 'C'], document)
    text = document.read_text()
    assert '## B\n\nof b\n\n## C\n\n1 of 3 trials' in text
    assert '| lost [s] | 0.25 |' in text
    assert f'| {NOT_FINITE} | 1 |' in text
    assert 'old' not in text


def test_help_lists_trials_and_durations(capsys):
    with pytest.raises(SystemExit):
        main(['--help'])
    printed = capsys.readouterr().out
    for name, chosen in CAMPAIGNS.items():
        (line,) = [line for line in printed.splitlines() if line.split()[:1] == [name] and 'trials' in line]
        assert f'{chosen.trials} trials' in line
        assert f'{chosen.seconds / 60:.0f} min' in line
    with pytest.raises(SystemExit):
        main(['nothing'])
    assert 'unknown campaign nothing' in capsys.readouterr().err


def test_faults_of_a_call_are_found(monkeypatch):
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


def test_an_orphan_and_a_hang_are_found(tmp_path):
    with processes(tmp_path) as made:
        sleeper = [sys.executable, '-c', 'import time; time.sleep(100)']
        child = subprocess.Popen(sleeper, env=made.environment)
        assert [fault.kind for fault in made.ended(0.5)] == [ORPHAN]
        made.started['sleeper'] = child
        (tmp_path / 'sleeper.log').write_text('')
        assert [fault.kind for fault in made.ended(0.5)] == [HANG]
    assert child.poll() is not None


def test_a_slow_run_that_prints_its_progress_is_not_a_hang(tmp_path):
    program = 'import time\nfor _ in range(8): print(end="on ", flush=True); time.sleep(0.25)'
    with processes(tmp_path) as made, (tmp_path / 'slow.log').open('wb') as log:
        made.started['slow'] = subprocess.Popen([sys.executable, '-c', program], env=made.environment, stdout=log)
        assert made.ended(1.0) == []
        assert made.started['slow'].returncode == 0


def test_a_false_claim_is_found(tmp_path, simulated):
    run = simulated(tmp_path / 'run', '-p', 'duration:=0.01', '-p', 'plot:=false')
    assert list(false_claims(run, 0, None)) == []
    assert [fault.kind for fault in false_claims(run, 1, None)] == [WRONG]
    other = simulated(tmp_path / 'other', '-p', 'duration:=0.01', '-p', 'amplitude:=3.0', '-p', 'plot:=false')
    from hdd_servo_ros import Run

    assert {fault.kind for fault in false_claims(run, 0, Run.open(other))} == {WRONG}
    text = (run / 'run.yaml').read_text()
    (run / 'run.yaml').write_text(text.replace('last_tick: 100', 'last_tick: 99'))
    (fault,) = false_claims(run, 0, None)
    assert 'last_tick in run.yaml is 99, but the last tick in the bag is 100' in fault.message


def test_the_seed_determines_the_damage_of_a_file(tmp_path):
    original = originals(tmp_path)['mcap'] / 'bag' / 'bag.mcap'
    for number in range(20):
        contents = []
        for name in ('one', 'two'):
            path = tmp_path / name
            path.write_bytes(original.read_bytes())
            damage(path, random.Random(number))
            contents.append(path.read_bytes() if path.exists() else None)
        assert contents[0] == contents[1]
