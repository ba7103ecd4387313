"""Remap rules of a ROS command line, with rcl's grammar and order: the first rule that matches a name applies."""

import dataclasses
import re

from hdd_servo_ros.messages.shown import shown

_TOKEN = r'(?!\w*__)[A-Za-z_][A-Za-z0-9_]*'
_NAME = rf'(?:~/|/)?{_TOKEN}(?:/{_TOKEN})*'
_RULE = re.compile(
    rf'(?:(?P<node>{_TOKEN}):)?(?:'
    rf'(?P<own>__node|__name):=(?P<name>{_TOKEN})'
    rf'|__ns:=(?P<namespace>/|(?:/{_TOKEN})+)'
    rf'|(?:(?P<url>rostopic|rosservice)://)?(?P<match>{_NAME}):=(?P<replacement>{_NAME})'
    r')',
    re.ASCII,
)


class RemapError(ValueError):
    """A remap rule that rcl rejects."""


@dataclasses.dataclass(frozen=True)
class RemapRule:
    """
    Single remap rule.

    Attributes
    ----------
    text
        The rule as given.
    node
        Name of the node that the rule is for; empty for all.
    name, namespace
        New name or namespace of a node; empty for other rules.
    match, replacement
        Names of topics: absolute, relative, or private to the node (``~/name``); empty for other rules.
    """

    text: str
    node: str = ''
    name: str = ''
    namespace: str = ''
    match: str = ''
    replacement: str = ''

    @classmethod
    def parse(cls, text: str) -> 'RemapRule':
        """Parse a rule; raises :class:`RemapError`."""
        found = _RULE.fullmatch(text)
        if found is None:
            raise RemapError(
                f'-r {shown(text)} is not [NODE:]FROM:=TO with names of letters, digits, _ and /, '
                'nor [NODE:]__node:=NAME, nor [NODE:]__ns:=/NAMESPACE'
            )
        part = {key: value or '' for key, value in found.groupdict().items()}
        of_services = part['url'] == 'rosservice'
        return cls(
            text,
            part['node'],
            part['name'],
            part['namespace'],
            '' if of_services else part['match'],
            '' if of_services else part['replacement'],
        )

    def is_for(self, node: str) -> bool:
        """Return whether the rule is for the node with this name."""
        return self.node in ('', node)


@dataclasses.dataclass(frozen=True)
class Remapping:
    """Remap rules of a command line, in order."""

    rules: tuple[RemapRule, ...] = ()

    def node_name(self, node: str) -> str:
        """Return the remapped name of a node, given the default name of its executable."""
        return next((rule.name for rule in self.rules if rule.name and rule.is_for(node)), node)

    def namespace(self, node: str) -> str:
        """Return a node's namespace, ``/`` by default; rules match the remapped node name."""
        name = self.node_name(node)
        return next((rule.namespace for rule in self.rules if rule.namespace and rule.is_for(name)), '/')

    def full_name(self, node: str) -> str:
        """Return a node's name with its namespace."""
        return f'{self.namespace(node).rstrip("/")}/{self.node_name(node)}'

    def topic(self, node: str, topic: str) -> str:
        """Return the remapped full name of a node's topic."""
        name = self._expanded(node, topic)
        own = self.node_name(node)
        for rule in self.rules:
            if rule.match and rule.is_for(own) and self._expanded(node, rule.match) == name:
                return self._expanded(node, rule.replacement)
        return name

    def _expanded(self, node: str, name: str) -> str:
        if name.startswith('/'):
            return name
        if name.startswith('~/'):
            return f'{self.full_name(node)}{name[1:]}'
        return f'{self.namespace(node).rstrip("/")}/{name}'
