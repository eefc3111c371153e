"""`sysid effects`, `add`, `remove`, `new-effect`: the catalogue, a model's effects, your own effects."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from models.commands.console import Progress, Status, as_called, write_json
from models.commands.options import FILE_PATH, effects_option, input_option, json_option, out_option
from models.errors import BadInput


@click.command()
@click.argument("effect", metavar="EFFECT")
@input_option("model", "M.toml", "Model file to add to.", required=True)
@out_option("M2.toml", "File for the new model.")
@effects_option()
def add(effect: str, model_file: Path, out: Path) -> int:
    """Add an effect of the catalogue to a model.

    Reads a model file, and writes another with the effect, which replaces one of the same slot.

    Example: sysid add table_tilt --model fitted.toml --out tilted.toml
    """
    from models.effect_catalogue import effect_class
    from models.model_file import read_model, write_model

    added = effect_class(effect)()
    before = read_model(model_file)
    if effect in [e.name() for e in before.effects]:
        raise BadInput(f"{model_file}: already has {effect}; fit it with: sysid fit, or remove it with: sysid remove")
    model = before.add(added)
    write_model(model, out)
    names = [e.name() for e in model.effects]
    replaced = ", ".join(e.name() for e in before.effects if e.name() not in names)
    print(f"{out}: {', '.join(names)}" + (f" (instead of {replaced})" if replaced else ""))
    return Status.DONE


@click.command()
@click.argument("effect", metavar="EFFECT")
@input_option("model", "M.toml", "Model file to remove the effect from.", required=True)
@out_option("M2.toml", "File for the new model.")
@effects_option()
def remove(effect: str, model_file: Path, out: Path) -> int:
    """Remove an effect from a model.

    Reads a model file, and writes another without the effect.

    Example: sysid remove table_tilt --model tilted.toml --out level.toml
    """
    from models.files.faults import closest
    from models.model_file import read_model, write_model

    before = read_model(model_file)
    names = [e.name() for e in before.effects]
    if effect not in names:
        meant = closest(effect, names)
        hint = f"did you mean {meant}?" if meant else f"it has {', '.join(names) or 'none'}"
        raise BadInput(f"{model_file}: has no effect {effect!r}; {hint}")
    write_model(before.without(effect), out)
    names.remove(effect)
    print(f"{out}: {', '.join(names) or 'no effects, so the contacts are those of MuJoCo'}")
    return Status.DONE


@click.command()
@click.argument("names", metavar="[NAME]...", nargs=-1)
@click.option("--check", is_flag=True, help="Report every fault of these effects, of those in --effects, or of all.")
@json_option
@effects_option(exposed=True)
@click.pass_obj
def effects(
    progress: Progress, names: tuple[str, ...], check: bool, json_file: Path | None, effect_folders: tuple[str, ...]
) -> int:
    """List the effects of the catalogue, or check their contract.

    Prints formula, hooks and parameters of the effects named, or of all. Status 1 if --check finds a fault.

    Example: sysid effects table_tilt cloth_nap
    """
    from models.contract.checks import described, faults
    from models.effect_catalogue import add_folder, catalogue, effect_class

    own = [name for folder in effect_folders for name in add_folder(folder)]
    entries: list[dict[str, Any]] = []
    for name in dict.fromkeys(names or (own if check and own else catalogue())):
        entry = described(effect_class(name))
        entries.append(entry)
        if check:
            progress(f"checking {name}")
            entry["faults"] = faults(effect_class(name))
            progress.close()
            print("\n".join([f"{name}: {fault}" for fault in entry["faults"]] or [f"{name}: no faults"]), flush=True)
        else:
            _print_effect(name, entry)
    if json_file:
        write_json(json_file, {"effects": entries})
    return Status.FINDING if any(entry.get("faults") for entry in entries) else Status.DONE


def _print_effect(name: str, entry: dict[str, Any]) -> None:
    """An effect's hooks, formula and parameters."""
    print(f"{name}  ({', '.join(entry['doors'])}{'; slot ' + entry['slot'] if entry['slot'] else ''})")
    print("\n".join(f"  {text}" for text in (entry["says"], entry["formula"]) if text))
    for key, meta in entry["parameters"].items():
        low, high = meta["bounds"]
        off = "no value switches it off" if meta["off"] is None else f"off at {meta['off']:g}"
        print(f"    {key} = {meta['default']:g} [{meta['unit']}], {low:g} to {high:g}, {off}: {meta['source']}")
        if "published" in meta:
            print("      published: {:g} to {:g} ({})".format(*meta["published"], meta["published_by"]))


@click.command()
@click.argument("name", metavar="NAME")
@click.option("--dir", "folder", metavar="DIR", type=FILE_PATH, default="effects", show_default=True, help="Folder.")
@input_option("from", "result.json", "Begin with the structure that a discovery left unexplained.")
@effects_option()
def new_effect(name: str, folder: Path, from_file: Path | None) -> int:
    """Write the file of a new effect, to be filled in, and its test.

    NAME is in lowercase, words joined by _. Writes DIR/NAME.py, which runs as written, and DIR/test_NAME.py.

    Example: sysid new-effect worn_patch --from out/result.json
    """
    from sysid.new_effect import checked_name, source_of, write

    checked_name(name)
    effect, test = write(name, folder, source_of(from_file, name) if from_file else None)
    todo = "state its cause, source and bounds" if from_file else "replace its formula"
    print(f"{effect}: the effect, which runs as written; {todo}")
    print(f"{test}: its test; run it with: python -m pytest {test}")
    print(f"check it with: {as_called(f'sysid effects --check --effects {folder}')}")
    return Status.DONE
