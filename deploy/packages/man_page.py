#!/usr/bin/env python3
"""Writes a page of the manual from what a program says of itself.

    man_page.py PROGRAM SECTION [--see-also PAGE(SECTION)]... > page.1

Reads `PROGRAM --help` and, of each command that it lists, `PROGRAM COMMAND... --help`, as CLI11 formats them: a
description, "Usage:", then sections of two columns ("Options:", "Positionals:", "Subcommands:"), then a footer.
"""
import argparse
import pathlib
import re
import subprocess

SECTION = re.compile(r"^(Positionals|Options|Subcommands):$")
ENTRY = re.compile(r"^  (\S.*?)(?:\s{2,}(\S.*))?$")


class Help:
    """One --help, in its parts."""

    def __init__(self, text):
        self.description, self.usage, self.sections, self.footer = [], "", {}, []
        part = self.description
        for line in text.splitlines():
            section = SECTION.match(line)
            if section:
                part = self.sections.setdefault(section[1], [])
            elif line.startswith("Usage: "):
                self.usage = line[len("Usage: "):]
            elif part is self.description or part is self.footer:
                part.append(line)
            elif not line.strip():
                part = self.footer if part else part  # an empty line ends a section
            elif line.startswith("  "):
                self.add_entry(part, line)
            else:
                part = self.footer
                part.append(line)

    @staticmethod
    def add_entry(entries, line):
        entry = ENTRY.match(line)
        if entry:
            entries.append([entry[1], entry[2] or ""])
        elif entries:  # the help of an entry whose names fill the first column
            entries[-1][1] = (entries[-1][1] + " " + line.strip()).strip()


def escaped(text):
    text = text.replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq")
    return "\\&" + text if text.startswith((".", "\\(aq")) else text


def paragraphs(lines):
    """Lines as they are: examples and tables stay what they are."""
    text = "\n".join(lines).strip("\n")
    return [".nf", *(escaped(line) for line in text.splitlines()), ".fi"] if text else []


def entries(listed):
    page = []
    for names, text in listed:
        page += [".TP", ".B " + escaped(names), escaped(text) or "\\&"]
    return page


def read(program, path):
    run = subprocess.run([program, *path, "--help"], stdout=subprocess.PIPE, text=True, check=True)
    # Defaults beside the program are those of the program that is installed.
    return Help(run.stdout.replace(str(pathlib.Path(program).resolve().parent), "/usr/bin"))


def commands(program, path, help_text, page):
    for name, _ in help_text.sections.get("Subcommands", []):
        below = [*path, name.split()[0]]
        part = read(program, below)
        page += [".SS " + escaped(" ".join([pathlib.Path(program).name, *below]))]
        page += [".B " + escaped(part.usage), ".PP"]
        page += paragraphs(part.description)
        page += entries(part.sections.get("Positionals", []))
        page += entries([e for e in part.sections.get("Options", []) if not e[0].startswith("-h,")])
        page += [".PP", *paragraphs(part.footer)] if part.footer else []
        commands(program, below, part, page)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program")
    parser.add_argument("section")
    parser.add_argument("--see-also", action="append", default=[])
    options = parser.parse_args()
    name = pathlib.Path(options.program).name
    version = subprocess.run([options.program, "--version"], stdout=subprocess.PIPE, text=True, check=True).stdout
    top = read(options.program, [])
    summary = top.description[0] if top.description else name
    summary = re.split(r": |\. ", re.sub(rf"^{re.escape(name)}: ", "", summary))[0].rstrip(".")
    page = [f'.TH "{name.upper()}" "{options.section}" "" "Maneuver {version.split()[-1]}" "Maneuver"',
            ".ad l",  # long words, such as a list of choices, cannot be spread over a line
            ".SH NAME", f"{escaped(name)} \\- {escaped(summary[0].lower() + summary[1:])}",
            ".SH SYNOPSIS", ".B " + escaped(top.usage), ".SH DESCRIPTION", *paragraphs(top.description)]
    if top.sections.get("Options"):
        page += [".SH OPTIONS", *entries(top.sections["Options"])]
    below = []
    commands(options.program, [], top, below)
    if below:
        page += [".SH COMMANDS", *below]
    if top.footer:
        page += [".SH NOTES", *paragraphs(top.footer)]
    if options.see_also:
        page += [".SH SEE ALSO", escaped(", ".join(options.see_also))]
    print("\n".join(page))


if __name__ == "__main__":
    main()
