#!/usr/bin/python3
"""Checks every Markdown page of a folder, and every mention of a page in other files.

    tests/docs/check_pages.py [FOLDER]          the repository, or an installed tree of pages with --installed

- Every relative link leads to a file, and its anchor to a heading or an `<a id>` of that page.
- A path in backticks that begins with a folder of the repository exists.
- Files that are not pages name only pages of docs/ that exist, with their anchors.
- docs/README.md leads to every page of docs/.
- A line has at most 120 characters. Longer may be: a row of a table, code in a fence, and a line that has no
  space to break it at beside those within one link.
- No file names a folder of the machine that it was written on.

--installed checks links and anchors alone: that is where a page that lost its neighbours shows.
"""

import argparse
import os
import pathlib
import re
import subprocess
import sys

WIDTH = 120
TOP_FOLDERS = "client|cmake|deploy|docs|model|proto|server|tests"
SKIPPED_FOLDERS = {".git", "build", "node_modules", ".cache", "__pycache__"}
LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\[\]]*\]|\\.)*\]\(([^()\s]*)(?:\s+\"[^\"]*\")?\)")
MENTION = re.compile(r"(?<![\w/.-])docs/[\w./-]+\.(?:md|png|svg)(?:#[\w-]+)?")
ELSEWHERE = re.compile(r"[a-z][a-z0-9+.-]*:")
QUOTED_PATH = re.compile(rf"`((?:{TOP_FOLDERS})/[\w./-]+)`")
# Homes, and folders that only some machines have.
MACHINE = re.compile(r"(?<![\w./-])/(?:work/|home/\w|root/\w|Users/\w|tmp/real)")


def anchor(heading):
    """The anchor that forges make of a heading: its words in lower case, joined by hyphens."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").strip().lower()
    return re.sub(r"[^\w\- ]", "", text).replace(" ", "-")


class Page:
    """A Markdown page: its lines outside fences, its anchors and its links."""

    def __init__(self, path):
        self.path = path
        self.prose = []  # (number, line); without code in fences
        fence = None
        for number, line in enumerate(path.read_text().splitlines(), 1):
            mark = re.match(r"\s*(`{3,}|~{3,})", line)
            if fence is None and mark:
                fence = mark[1]
            elif fence is not None:
                if mark and mark[1].startswith(fence) and not line.strip(" `~"):
                    fence = None
            else:
                self.prose.append((number, line))
        self.anchors = set()
        for _, line in self.prose:
            heading = re.match(r"#{1,6}\s+(.*?)\s*#*$", line)
            if heading:
                self._add_heading(anchor(heading[1]))
            self.anchors.update(re.findall(r"<a (?:id|name)=\"([^\"]+)\"", line))

    def _add_heading(self, name):
        """A heading that comes again gets -1, -2 and so on."""
        candidate, again = name, 0
        while candidate in self.anchors:
            again += 1
            candidate = f"{name}-{again}"
        self.anchors.add(candidate)

    def links(self):
        """Yields (line number, target) of each link; code between backticks has none."""
        text = "\n".join(line for _, line in self.prose)
        numbers = [number for number, _ in self.prose]
        text = re.sub(r"(`+)(?!`)[^`]*?(?<!`)\1(?!`)", lambda code: re.sub(r"[^\n]", "x", code[0]), text)
        for link in LINK.finditer(text):
            yield numbers[text.count("\n", 0, link.start())], link[1]


def may_be_longer(line):
    """Whether a line of more than WIDTH characters cannot be broken, or is a row of a table."""
    if line.lstrip().startswith("|"):
        return True
    without_links = LINK.sub(lambda link: "x" * len(link[0]), line)
    return " " not in without_links.lstrip(" -*0123456789.>").rstrip()


class Check:
    def __init__(self, root):
        self.root = root
        self.pages = {}
        self.faults = []

    def fault(self, path, number, text):
        self.faults.append(f"{path.relative_to(self.root)}:{number}: {text}")

    def page(self, path):
        if path not in self.pages:
            self.pages[path] = Page(path)
        return self.pages[path]

    def find(self, path, number, target, start=None):
        """Checks that a link of `path` leads to a file, anchor included. It starts in the folder of `path`."""
        file, _, name = target.partition("#")
        found = pathlib.Path(os.path.normpath((start or path.parent) / file)) if file else path
        if not found.is_relative_to(self.root):
            self.fault(path, number, f"leads out of the tree: {target}")
        elif not found.exists():
            self.fault(path, number, f"leads nowhere: {target}")
        elif name and found.suffix == ".md" and name not in self.page(found).anchors:
            self.fault(path, number, f"has no such anchor: {target}")

    def links(self, path):
        for number, target in self.page(path).links():
            if not ELSEWHERE.match(target):
                self.find(path, number, target)

    def prose(self, path):
        for number, line in self.page(path).prose:
            if len(line) > WIDTH and not may_be_longer(line):
                self.fault(path, number, f"has {len(line)} characters; {WIDTH} are the most")
            for quoted in QUOTED_PATH.findall(line):
                if not (self.root / quoted).exists():
                    self.fault(path, number, f"names what is not there: {quoted}")

    def mentions(self, path):
        """Checks what a file that is not a page says of pages, and that no file names this machine."""
        try:
            lines = path.read_text().splitlines()
        except UnicodeDecodeError:
            return
        for number, line in enumerate(lines, 1):
            for mention in MENTION.findall(line) if path.suffix != ".md" else []:
                self.find(path, number, mention, self.root)
            if MACHINE.search(line):
                self.fault(path, number, f"names a folder of a machine: {line.strip()[:80]}")

    def index(self):
        """docs/README.md leads, perhaps by way of other pages, to every page of docs/."""
        docs = self.root / "docs"
        seen, waiting = set(), [docs / "README.md"]
        while waiting:
            page = waiting.pop()
            if page not in seen and page.suffix == ".md" and page.exists():
                seen.add(page)
                waiting += [pathlib.Path(os.path.normpath(page.parent / target.partition("#")[0]))
                            for _, target in self.page(page).links() if not ELSEWHERE.match(target)]
        for page in sorted(set(docs.rglob("*.md")) - seen):
            self.fault(page, 1, "docs/README.md does not lead here")


def files_of(root):
    """What git tracks or would; where there is no git, all but build folders."""
    listed = subprocess.run(["git", "-C", root, "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
                            capture_output=True)
    if listed.returncode == 0:
        paths = [root / name for name in listed.stdout.decode().split("\0") if name]
        return sorted(path for path in paths if path.is_file())
    return sorted(pathlib.Path(folder) / name for folder, folders, names in os.walk(root)
                  if not SKIPPED_FOLDERS & set(pathlib.Path(folder).relative_to(root).parts) for name in names)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=pathlib.Path, default=pathlib.Path(__file__).parents[2])
    parser.add_argument("--installed", action="store_true", help="links and anchors alone")
    options = parser.parse_args()
    check = Check(options.folder.resolve())
    files = sorted(check.root.rglob("*")) if options.installed else files_of(check.root)
    pages = [file for file in files if file.suffix == ".md"]
    for page in pages:
        check.links(page)
        if not options.installed:
            check.prose(page)
    if not options.installed:
        for file in files:
            check.mentions(file)
        check.index()
    print("\n".join(check.faults + [f"{len(pages)} pages, {len(check.faults)} faults"]))
    return 1 if check.faults or not pages else 0


if __name__ == "__main__":
    sys.exit(main())
