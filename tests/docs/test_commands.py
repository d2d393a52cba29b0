"""Commands in the text exist: command, options, choices, number of arguments."""

import re
import shlex

import click
import pytest

from tests.docs.sources import generator, pages

FENCED = re.compile(r"^```(?:bash|sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(rock2d [a-z][^`\n]*)`")


def shown() -> list[tuple[str, str]]:
    """Every command line of the text with the page on which it stands."""
    found = []
    for path, text in pages():
        lines = [line for block in FENCED.findall(text) for line in block.splitlines()]
        lines += INLINE.findall(text)
        found += [(path.name, line.strip()) for line in lines if line.strip().startswith("rock2d ")]
    found += [(f"{words} --help", line) for words, line in examples()]
    return sorted(set(found))


def examples() -> list[tuple[str, str]]:
    """The words of every command, and the example in its help."""
    return [
        (words, line)
        for words, command in generator().commands()
        for line in re.findall(r"^ *Example: (.*)$", command.help or "", re.MULTILINE)
    ]


@pytest.mark.parametrize(("page", "line"), shown())
def test_command_line_exists(page, line):
    from rock2d.cli import cli

    words = shlex.split(line, comments=True)[1:]
    if words and words[0] in ("COMMAND", "--help", "--version"):
        return
    command: click.Command = cli
    while isinstance(command, click.Group) and words:
        assert words[0] in command.commands or words[0].isupper(), f"{page}: no command {words[0]} in {line!r}"
        command = command.commands[words.pop(0)]
    if isinstance(command, click.Group) or not words or "--help" in words:
        return  # the name of a command alone
    context = click.Context(command, info_name=line)
    values, _arguments, _ = command.make_parser(context).parse_args(words)  # raises for an unknown option
    for option in command.params:
        value = values.get(option.name)
        if value is None:
            missing = option.required and isinstance(option, click.Option)
            assert not missing, f"{page}: {line!r} lacks {option.opts[0]}"
        elif isinstance(option, click.Option) and isinstance(option.type, click.Choice):
            for one in value if isinstance(value, list) else [value]:
                assert one in option.type.choices, f"{page}: {one} is no choice of {option.opts[0]}"


def test_every_command_is_documented():
    page = generator().cli_page()
    for words, command in generator().commands():
        assert f"## {words}\n" in page
        assert command.help
        for option in command.params:
            if isinstance(option, click.Option):
                assert f"`{option.opts[0]}`" in page
                assert option.help, f"{words} {option.opts[0]} has no help"


def test_every_command_has_one_example_of_itself_in_its_help():
    found = examples()
    assert [words for words, _ in found] == [words for words, _ in generator().commands()]
    assert all(line.startswith(f"{words} ") for words, line in found)
