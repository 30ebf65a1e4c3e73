"""Imports of a source tree, read from the text without running it, and the circles in them.

A module is named by its dotted name; a package's `__init__.py` by its own, `package.__init__`. Imports inside
functions and under TYPE_CHECKING count like the others. Importing `a.b` runs `a/__init__.py`, too; that is no edge
here, as every module of a package would have it: an edge to `a.__init__` stands for a name taken from there.
"""

import ast


def modules(package, folder):
    """Every module of the package in `folder`: dotted name to file."""
    every = sorted(folder.rglob("*.py"))
    return {".".join((package, *path.relative_to(folder).with_suffix("").parts)): path for path in every}


def imported(module, path):
    """Dotted names that the file imports, relative ones resolved: `a.b.name` for `from a.b import name`."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = module.split(".")[: -node.level] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            names.update(f"{source}.{alias.name}" for alias in node.names)
    return names


def graph(sources):
    """Module to the modules among `sources` that it imports."""
    return {module: _among(sources, imported(module, path)) - {module} for module, path in sources.items()}


def _among(sources, names):
    """The modules that hold the names: `a.b.name` is the module `a.b.name`, or a name in `a.b`."""
    found = set()
    for name in names:
        for module in (name, f"{name}.__init__", holder := name.rpartition(".")[0], f"{holder}.__init__"):
            if module in sources:
                found.add(module)
                break
    return found


def rooms(of):
    """Folder to the graph of what stands in it, files and folders, each folder taken as one room.

    A folder's `__init__` is the door and no room: it may import what stands in the folder, and the rooms beside the
    folder import it; what a room takes from the door of its own folder is an edge that `graph` has.
    """
    found: dict[str, dict[str, set[str]]] = {}
    for module, targets in of.items():
        for target in targets:
            here, there = module.split("."), target.split(".")
            level = next((n for n, (a, b) in enumerate(zip(here, there, strict=False)) if a != b), None)
            if not level or "__init__" in (here[level], there[level]):
                continue
            inside = found.setdefault(".".join(here[:level]), {})
            inside.setdefault(here[level], set()).add(there[level])
            inside.setdefault(there[level], set())
    return found


def circles(of):
    """Sets of two and more nodes that reach each other, sorted."""

    def reached(start):
        found: set[str] = set()
        waiting = [start]
        while waiting:
            new = set(of.get(waiting.pop(), ())) - found
            found |= new
            waiting += new
        return found

    every = {node: reached(node) for node in of}
    sets = {
        tuple(sorted(x for x in every[node] if node in every.get(x, ())))
        for node in of
        if node in every[node]
    }
    return sorted(list(each) for each in sets if len(each) > 1)
