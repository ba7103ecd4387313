"""Links, anchors and images of the documentation have targets, and every page is reachable; no network."""

import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DOCS = ROOT / 'docs'
MARKDOWN = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted(DOCS.rglob('*.md'))]
RST = sorted(DOCS.rglob('*.rst'))


def identifier(path):
    return path.relative_to(ROOT).as_posix()


def prose(text):
    """Return Markdown without its blocks of code and inline code, in which brackets are not links."""
    text = re.sub(r'^(```+)[^\n]*\n.*?^\1\s*$', '', text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r'`[^`]*`', '`code`', text)


def links(text):
    """Return the targets of a Markdown document's links and images, inline and by reference."""
    text = prose(text)
    return {*re.findall(r'\]\(([^()\s]+)\)', text), *re.findall(r'^\[[^\]]+\]: +(\S+)', text, re.MULTILINE)}


def anchors(path):
    """Return the anchors of a Markdown document's headings, as GitHub and MyST make them."""
    text = re.sub(r'^(```+)[^\n]*\n.*?^\1\s*$', '', path.read_text('utf8'), flags=re.MULTILINE | re.DOTALL)
    found: set[str] = set()
    seen: Counter[str] = Counter()
    for heading in re.findall(r'^#+ (.+)$', text, re.MULTILINE):
        shown = re.sub(r'\[([^\]]*)\]\([^)]*\)', r'\1', heading)
        anchor = re.sub(r'[^\w\- ]', '', shown.strip()).lower().replace(' ', '-')
        found.add(f'{anchor}-{seen[anchor]}' if seen[anchor] else anchor)
        seen[anchor] += 1
    return found


def broken(path, root=ROOT):
    """Return the links of a Markdown document without a target."""
    wrong = []
    for link in sorted(links(path.read_text('utf8'))):
        if re.match(r'[a-z]+:', link):
            continue
        name, _, anchor = link.partition('#')
        target = (path.parent / name).resolve() if name else path
        if not target.is_relative_to(root) or not target.exists():
            wrong.append(f'{link}: no such file')
        elif anchor and (target.suffix != '.md' or anchor not in anchors(target)):
            wrong.append(f'{link}: no such heading')
    return wrong


def toctrees(path):
    """Return the documents that the tables of contents of a page list, as paths without suffix."""
    text = path.read_text('utf8') + '\n'
    blocks = re.findall(r'^\.\. toctree::\n((?:(?: +.*)?\n)*)', text, re.MULTILINE)
    blocks += re.findall(r'^```\{toctree\}\n(.*?)^```', text, re.MULTILINE | re.DOTALL)
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    entries = [re.sub(r'.*<(.+)>$', r'\1', line) for line in lines if line and not line.startswith(':')]
    return [page(path, entry) for entry in entries]


def page(path, entry):
    """Return the page that an entry names, without suffix; one with a slash begins at the top."""
    return (ROOT / entry[1:] if entry.startswith('/') else path.parent / entry).resolve()


def exists(found):
    return any(found.with_name(found.name + suffix).is_file() for suffix in ('.md', '.rst'))


@pytest.mark.parametrize('path', MARKDOWN, ids=identifier)
def test_every_link_has_a_target(path):
    assert not broken(path)


@pytest.mark.parametrize('path', RST, ids=identifier)
def test_every_page_that_an_rst_page_names_exists(path):
    named = [page(path, entry) for entry in re.findall(r':doc:`(?:[^`<]*<)?([^`<>]+)>?`', path.read_text('utf8'))]
    assert not [found for found in [*named, *toctrees(path)] if not exists(found)]


def test_every_page_is_in_one_table_of_contents():
    listed = Counter(found.relative_to(ROOT).as_posix() for path in [*RST, *MARKDOWN] for found in toctrees(path))
    pages = {path.relative_to(ROOT).with_suffix('').as_posix() for path in [*MARKDOWN, *RST]} | {'CHANGELOG'}
    assert set(listed) == pages - {'docs/index'}
    assert set(listed.values()) == {1}


def test_every_image_is_shown():
    shown = set()
    for path in MARKDOWN:
        targets = {link for link in links(path.read_text('utf8')) if not re.match(r'[a-z]+:', link)}
        shown |= {(path.parent / link.partition('#')[0]).resolve() for link in targets}
    assert {path for path in (DOCS / 'images').iterdir() if path not in shown} == set()


def test_a_broken_link_is_found(tmp_path):
    (tmp_path / 'other.md').write_text('# A heading\n\n## Twice\n\n## Twice\n\n## `code` in it: yes\n')
    good = 'other.md other.md#a-heading other.md#twice-1 other.md#code-in-it-yes #here https://example.org/x'
    document = tmp_path / 'a.md'
    document.write_text('# Here\n' + '\n'.join(f'[text]({link})' for link in good.split()))
    assert broken(document, tmp_path) == []
    bad = 'missing.md other.md#nowhere other.md#twice-2 #elsewhere ../outside.md ![picture](missing.png)'
    document.write_text(
        '\n'.join(link if link.startswith('!') else f'[text]({link})' for link in bad.split())
        + '\n`[no link](missing2.md)`\n```text\n[none](missing3.md)\n```\n[by name]: missing4.md\n'
    )
    assert len(broken(document, tmp_path)) == 7
