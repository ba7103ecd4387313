"""Diagram `docs/images/graph.svg` of nodes and topics, from the catalog and the topic definitions."""

from collections.abc import Iterator
from xml.sax.saxutils import escape, quoteattr

from hdd_servo_ros.graph.catalog import CONTROLLERS, NODES
from hdd_servo_ros.graph.connections import TOPICS, readers_of, shown_delay
from hdd_servo_ros.messages.topics import RECORDER, LoopTopic, Reader

_COLUMN, _LANE = 138, 42
"""Distance between two nodes, and between two topics [px]."""
_BOX_WIDTH, _BOX_HEIGHT, _TOP, _MARGIN = 132, 36, 12, 8
_SOLID, _OPTIONAL = '#456', '#999'
_MINUS = '\N{MINUS SIGN}'
_FONT = 'font-family="sans-serif" font-size="12"'


def columns() -> tuple[str, ...]:
    """Return the nodes and roles from left to right: in the order of a tick, with the recorder last."""
    named = {name for topic in TOPICS for name in (topic.writer, *(reader.node for reader in topic.readers))}
    ordered = dict.fromkeys(
        row.name if row.name in named else row.role or row.name for row in NODES.values() if row.name != RECORDER
    )
    ordered.update(dict.fromkeys(topic.writer for topic in TOPICS if topic.writer != RECORDER))
    return (*ordered, RECORDER)


def drawing() -> str:
    """Return the diagram as SVG: one column per node, and one line per topic from its writer to its readers."""
    names = columns()
    width = 2 * _MARGIN + _COLUMN * len(names)
    bottom = _TOP + _BOX_HEIGHT + _LANE * len(TOPICS) + 22
    notes = (
        f'controller: {", ".join(CONTROLLERS)}, or a custom one',
        f'k {_MINUS} 1: at tick k it needs an earlier message; dashed: in runs that include such a node',
    )
    height = bottom + 20 * len(notes) + 12
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" {_FONT}>',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        *(f'<path d="M{_x(name)} {_TOP} V{bottom}" stroke="#cfd8e3" stroke-width="1.2"/>' for name in names),
        *(_box(name) for name in names),
        *(part for topic in TOPICS for reader in readers_of(topic) for part in _edge(topic, reader)),
        *(_label(topic) for topic in TOPICS),
        *(
            f'<text x="{_MARGIN + 4}" y="{bottom + 20 * (number + 1)}" fill="#555">{escape(note)}</text>'
            for number, note in enumerate(notes)
        ),
        '</svg>',
    ]
    return '\n'.join(parts) + '\n'


def _x(name: str) -> int:
    return _MARGIN + _COLUMN // 2 + _COLUMN * columns().index(name)


def _y(topic: LoopTopic) -> int:
    return _TOP + _BOX_HEIGHT + 34 + _LANE * TOPICS.index(topic)


def _color(topic: LoopTopic) -> str:
    return _OPTIONAL if topic.is_optional else _SOLID


def _box(name: str) -> str:
    left = _x(name) - _BOX_WIDTH // 2
    written = [topic for topic in TOPICS if topic.writer == name]
    is_optional = name != RECORDER and bool(written) and all(topic.is_optional for topic in written)
    style = (
        f'fill="#fff" stroke="{_OPTIONAL}" stroke-dasharray="5 4"' if is_optional else 'fill="#eef4fb" stroke="#456"'
    )
    return (
        f'<rect x="{left}" y="{_TOP}" width="{_BOX_WIDTH}" height="{_BOX_HEIGHT}" rx="7" {style} stroke-width="1.5"/>'
        f'<text x="{_x(name)}" y="{_TOP + 22}" text-anchor="middle" font-weight="bold" font-size="11">{name}</text>'
    )


def _edge(topic: LoopTopic, reader: Reader) -> Iterator[str]:
    """Draw the line from the writer of a topic to a reader, with an arrowhead and the delay."""
    start, end, y = _x(topic.writer), _x(reader.node), _y(topic)
    step = 8 if start < end else -8
    dashes = ' stroke-dasharray="5 4"' if topic.is_optional else ''
    data = f'data-topic={quoteattr(topic.name)} data-reader={quoteattr(reader.node)} data-delay="{reader.delay}"'
    yield f'<path {data} d="M{start} {y} H{end - step}" stroke="{_color(topic)}" stroke-width="1.6"{dashes}/>'
    yield f'<path d="M{end} {y} l{-step} -4 v8 z" fill="{_color(topic)}"/>'
    if reader.delay:
        text = f'k {_MINUS} {shown_delay(topic, reader).replace("+", _MINUS)}'
        anchor = 'end' if step > 0 else 'start'
        yield (
            f'<text x="{end - 2 * step}" y="{y + 14}" text-anchor="{anchor}" fill="#777" font-size="11">{text}</text>'
        )


def _label(topic: LoopTopic) -> str:
    """Draw the start of a topic at its writer, and its name."""
    x, y = _x(topic.writer), _y(topic)
    side = -1 if topic.writer == RECORDER else 1
    anchor = 'start' if side > 0 else 'end'
    return (
        f'<circle cx="{x}" cy="{y}" r="4" fill="{_color(topic)}"/>'
        f'<text x="{x + 9 * side}" y="{y - 6}" text-anchor="{anchor}" fill="#234">/{topic.name}</text>'
    )
