"""Names in the pages' texts as links: pages, commands, scene keys and registers written as code."""

import re

import click
from docutils import nodes
from sphinx.transforms.post_transforms import SphinxPostTransform

from fastac.cli.main import main
from fastac.gateware.bus.register_map import REGISTERS
from fastac_docs.registers import register_id
from fastac_docs.scene_keys import key_id, known_keys

PAGE = re.compile(r"^docs/([\w-]+)\.md$")
KEYS = {key for key in known_keys() if "." in key}
"""Those with a table's name; others are too short to tell them from other words."""
NAMES = {register.name for register in REGISTERS}


def command_anchor(text: str) -> str | None:
    """The anchor of the command that a text begins with, None where it begins with none."""
    words, command = text.split(), main
    if not words or words.pop(0) != "fastac":
        return None
    anchor = "fastac"
    while isinstance(command, click.Group) and words:
        command = command.get_command(click.Context(command), words[0])
        if command is not None:
            anchor = f"{anchor}-{words.pop(0)}"
    return anchor if anchor != "fastac" else None


def target_of(text: str) -> tuple[str, str] | None:
    """(page, anchor) of what a piece of code names, None where that has no page."""
    if anchor := command_anchor(text):
        return "options", anchor
    if text in KEYS:
        return "scene_keys", key_id(text)
    name = text.split(".")[0]
    if name in NAMES:
        return "registers", register_id(name)
    return None


class Links(SphinxPostTransform):
    """Turns such code into links, but for that in links, headings and the pages of reference themselves."""

    default_priority = 200
    formats = ("html",)

    def run(self, **kwargs) -> None:
        env, builder = self.env, self.app.builder
        for node in list(self.document.findall(nodes.literal)):
            if isinstance(node.parent, nodes.reference | nodes.title):
                continue
            text = node.astext()
            if page := PAGE.match(text):
                if page[1] in env.titles:
                    uri = builder.get_relative_uri(env.docname, page[1])
                    link = nodes.reference("", env.titles[page[1]].astext(), refuri=uri, internal=True)
                    node.replace_self(link)
                continue
            found = target_of(text)
            if found and found[0] in env.titles and found[0] != env.docname:
                uri = f"{builder.get_relative_uri(env.docname, found[0])}#{found[1]}"
                link = nodes.reference("", "", refuri=uri, internal=True)
                node.replace_self(link)
                link += node
