"""The public names are in the reference with examples, and the examples print what they say."""

import ast
import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

import hdd_servo_ros
from hdd_servo_ros.parameters import ParameterSet

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / 'hdd_servo_ros'
PAGES = sorted((ROOT / 'docs' / 'reference' / 'api').glob('*.rst'))


def public_modules():
    """Return the modules that define ``__all__``: those are public."""
    for path in sorted(PACKAGE.rglob('*.py')):
        if any(
            isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == '__all__'
            for node in ast.parse(path.read_text('utf8')).body
        ):
            yield '.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__')


PUBLIC = {
    f'{module}.{name}': getattr(importlib.import_module(module), name)
    for module in public_modules()
    for name in importlib.import_module(module).__all__
    if name != '__version__'
}
"""The public objects by their full names."""


def documented(page):
    return re.findall(r'^\.\. auto(?:class|function|exception|data|decorator):: ([\w.]+)', page, re.MULTILINE)


def function(value):
    """Return the function of a kernel that Numba compiles, else the value itself."""
    return getattr(value, 'py_func', value)


def examples(value):
    doc = inspect.getdoc(function(value)) or ''
    return doctest.DocTestParser().get_examples(doc)


def needs_examples(value):
    """Parameter sets and errors are used in the examples of others; an alias of a type has none."""
    return not (isinstance(value, type) and issubclass(value, ParameterSet | Exception)) and (
        callable(function(value)) and inspect.getdoc(function(value)) is not None and hasattr(value, '__module__')
    )


EXAMPLES = {name: value for name, value in PUBLIC.items() if hasattr(function(value), '__doc__') and examples(value)}


def test_every_public_object_is_in_the_reference():
    named = [name for page in PAGES for name in documented(page.read_text('utf8'))]
    assert len(named) == len(set(named))
    assert set(named) <= set(PUBLIC)
    found = {id(PUBLIC[name]) for name in named}
    assert {name for name, value in PUBLIC.items() if id(value) not in found} == set()


def test_every_public_object_is_used_in_an_example():
    sources = '\n'.join(example.source for value in EXAMPLES.values() for example in examples(value))
    unused = {name for name in PUBLIC if not re.search(rf'\b{name.rpartition(".")[2]}\b', sources)}
    assert unused == NOT_IN_EXAMPLES
    assert {name for name, value in PUBLIC.items() if needs_examples(value)} <= set(EXAMPLES) | NOT_IN_EXAMPLES


NOT_IN_EXAMPLES = {
    'hdd_servo_ros.parameters.InvalidParameterError',
    'hdd_servo_ros.parameters.UnknownParameterError',
    'hdd_servo_ros.parameters.Value',
    'hdd_servo_ros.testing.CheckFailed',
    'hdd_servo_ros.testing.ExperimentFailed',
}
"""An alias of a type, kinds of ParameterError, and the exceptions of failed tests."""


class WithoutModules(doctest.OutputChecker):
    """Compares errors by the names of their classes, as readers see them, without those of their modules."""

    def check_output(self, want, got, optionflags):
        return super().check_output(want, re.sub(r'^(?:\w+\.)+(?=\w+: )', '', got), optionflags)


@pytest.fixture(scope='module')
def folder(simulated, tmp_path_factory):
    """Return a folder with the run that some examples open."""
    folder = tmp_path_factory.mktemp('examples')
    (folder / 'runs').mkdir()
    simulated(folder / 'runs' / 'first', '-p', 'duration:=0.3', '-p', 'plot:=false')
    return folder


@pytest.mark.parametrize('name', EXAMPLES)
def test_examples(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    names = {'hdd_servo_ros': hdd_servo_ros, '__name__': 'example'}
    doc = inspect.getdoc(function(EXAMPLES[name])) or ''
    test = doctest.DocTestParser().get_doctest(doc, names, name, None, None)
    said: list[str] = []
    runner = doctest.DocTestRunner(WithoutModules(), verbose=False)
    assert runner.run(test, out=said.append).failed == 0, ''.join(said)


def test_an_example_that_is_wrong_is_found():
    said: list[str] = []
    test = doctest.DocTestParser().get_doctest('>>> 1 + 1\n3\n', {}, 'wrong', None, None)
    assert doctest.DocTestRunner(WithoutModules(), verbose=False).run(test, out=said.append).failed == 1


def test_what_a_package_does_not_offer_is_rejected():
    with pytest.raises(AttributeError, match=r"module 'hdd_servo_ros\.drive' has no attribute 'Missing'"):
        importlib.import_module('hdd_servo_ros.drive').Missing  # noqa: B018
