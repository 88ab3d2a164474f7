"""The table of messages in docs/reference/messages.md, from the places in the code that raise them."""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "messages.md"
ROOTS = {"RigError": "rig", "CalibrationError": "calibration", "SimulationError": "sim"}
"""Errors that begin a tree, by the package that has it."""
BEGIN = """# Messages

Everything that `rig` refuses, by kind of error: the words as they are printed, *names* where a number or a name stands.
A message says what happened, which number met which limit, and what to try. Made from the code:
`python docs/site/messages.py`.

| error | exit status | what it is | messages |
|---|---:|---|---:|
"""
LEAST_WORDS = 3
"""A template with fewer words of its own says only what another function has worded."""


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the page as the code is now."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sources()}
    kinds = errors(trees)
    found = messages(trees, set(kinds))
    rows = [
        f"| {linked(name) if found[name] else f'`{name}`'} | {status} | {text} | {len(found[name])} |"
        for name, (status, text) in kinds.items()
    ]
    chapters = [chapter(name, found[name]) for name in kinds if found[name]]
    return BEGIN + "\n".join(rows) + "\n" + "".join(chapters)


def linked(name: str) -> str:
    """Return a link to an error's chapter."""
    return f"[`{name}`](#{name.lower()})"


def sources() -> list[Path]:
    """Return the files of the three packages."""
    return [path for package in ROOTS.values() for path in sorted((ROOT / package).rglob("*.py"))]


def errors(trees: dict[Path, ast.Module]) -> dict[str, tuple[int, str]]:
    """Return (exit status, what it is) of each error of the trees, by name, parents before children."""
    classes = {node.name: node for tree in trees.values() for node in tree.body if isinstance(node, ast.ClassDef)}
    found: dict[str, tuple[int, str]] = {}
    waiting = list(ROOTS)
    while waiting:
        name = waiting.pop(0)
        node = classes[name]
        parents = [found[base][0] for base in map(ast.unparse, node.bases) if base in found]
        found[name] = (own_status(node) or (parents[0] if parents else 1), first_sentence(node))
        waiting += [child for child, other in classes.items() if name in map(ast.unparse, other.bases)]
    return found


def own_status(node: ast.ClassDef) -> int | None:
    """Return the exit status that a class gives, if it gives one."""
    for item in node.body:
        if isinstance(item, ast.Assign) and ast.unparse(item.targets[0]) == "exit_code":
            return int(ast.literal_eval(item.value))
    return None


def first_sentence(node: ast.ClassDef) -> str:
    """Return the first line of a class's docstring."""
    return (ast.get_docstring(node) or "").splitlines()[0].rstrip(".")


def messages(trees: dict[Path, ast.Module], kinds: set[str]) -> dict[str, list[tuple[str, str]]]:
    """Return (template, room) of each message, by error, in the order of the rooms."""
    found: dict[str, set[tuple[str, str]]] = defaultdict(set)
    for path, tree in trees.items():
        room = "/".join(path.relative_to(ROOT).parts[:2]).removesuffix(".py")
        for name, template in raised(tree, kinds):
            found[name].add((template, room))
    return defaultdict(
        list, {name: sorted(rows, key=lambda row: (row[1], row[0].lower())) for name, rows in found.items()}
    )


def raised(tree: ast.Module, kinds: set[str]) -> Iterator[tuple[str, str]]:
    """Yield each error that is made with words of its own, and these words."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in kinds and node.args:
            template = " ".join(template_of(node.args[0]).split())
            if sum(word.isalpha() for word in template.replace("*", " * ").split() if word != "*") >= LEAST_WORDS:
                yield node.func.id, template


def template_of(node: ast.expr) -> str:
    """Return words with names in the place of what is filled in."""
    if isinstance(node, ast.Constant):
        return str(node.value).replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")
    if isinstance(node, ast.JoinedStr):
        return "".join(template_of(part) for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return template_of(node.left) + template_of(node.right)
    return f"*{name_of(node.value if isinstance(node, ast.FormattedValue) else node)}*"


def name_of(node: ast.expr) -> str:
    """Return a short name for an expression: the last word of what it is called, or what it is made of."""
    if isinstance(node, ast.Name):
        return node.id.strip("_").replace("_", " ")
    if isinstance(node, ast.Attribute):
        return node.attr.strip("_").replace("_", " ")
    if isinstance(node, ast.Call):
        return name_of((node.args or [node.func])[-1])
    if isinstance(node, ast.Subscript):
        return name_of(node.value)
    if isinstance(node, ast.BinOp):
        return name_of(node.left if not isinstance(node.left, ast.Constant) else node.right)
    names = [part.id for part in ast.walk(node) if isinstance(part, ast.Name)]
    return names[0].strip("_").replace("_", " ") if names else "…"


def chapter(name: str, rows: list[tuple[str, str]]) -> str:
    """Return the table of one error's messages."""
    lines = "".join(f"| {template} | `{room}` |\n" for template, room in rows)
    return f"\n## {name}\n\n| message | from |\n|---|---|\n{lines}"


if __name__ == "__main__":
    main()
    sys.exit(0)
