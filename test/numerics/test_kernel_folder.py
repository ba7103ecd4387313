import shutil
from pathlib import Path

from hdd_servo_ros.numerics import kernel_folder


def copied_package(directory):
    package = directory / 'hdd_servo_ros'
    shutil.copytree(kernel_folder.PACKAGE, package, ignore=shutil.ignore_patterns('__pycache__'))
    return package


def test_the_cache_goes_where_it_can(tmp_path, monkeypatch):
    """A read-only install, or no home, still starts warm the second time."""
    blocked = tmp_path / 'a_file'
    blocked.write_text('')
    monkeypatch.setenv('XDG_CACHE_HOME', str(blocked))
    monkeypatch.setattr(Path, 'home', lambda: tmp_path / 'home')
    assert tmp_path / 'home' in kernel_folder.kernel_cache_directory.__wrapped__().parents
    monkeypatch.setattr(Path, 'home', lambda: blocked)
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path / 'temporary'))
    found = kernel_folder.kernel_cache_directory.__wrapped__()
    assert tmp_path / 'temporary' in found.parents
    assert found.is_dir()


def test_a_change_of_any_kernel_source_takes_another_folder(tmp_path, monkeypatch):
    package = copied_package(tmp_path)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    monkeypatch.setattr(kernel_folder, 'PACKAGE', package)
    before = kernel_folder.kernel_cache_directory.__wrapped__()
    (package / 'nodes' / 'rig.py').write_text('')
    assert kernel_folder.kernel_cache_directory.__wrapped__() == before
    for changed in ('drive/friction/parameters.py', 'messages/controller_inputs.py', 'simulation/closed_loop.py'):
        source = package / changed
        source.write_text(source.read_text() + '\n')
        after = kernel_folder.kernel_cache_directory.__wrapped__()
        assert after != before, changed
        before = after


def test_the_place_of_the_package_does_not_count(tmp_path):
    assert kernel_folder.sources_digest(copied_package(tmp_path)) == kernel_folder.sources_digest(kernel_folder.PACKAGE)


def test_every_folder_with_a_kernel_counts():
    package = kernel_folder.PACKAGE
    kernels = [path.relative_to(package) for path in package.rglob('*.py') if '\n@compiled\n' in path.read_text()]
    assert len(kernels) > 20
    assert {path.parts[0] for path in kernels} <= set(kernel_folder._SOURCES)
    assert all((package / name).exists() for name in kernel_folder._SOURCES)
