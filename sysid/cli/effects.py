"""`sysid effects`, `new-effect` and `add`: the catalogue, an effect of one's own, one on a model's stack."""

from __future__ import annotations

import argparse
from typing import Any

from models.console import DONE, FOUND, Progress, Verb, check_outputs, write_json
from sysid.cli.common import with_effects


def register(verb: Verb) -> None:
    """These verbs with their options."""
    one = verb("add", add, "put an effect on a model's stack")
    one.add_argument("effect", metavar="EFFECT")
    one.add_argument("--model", metavar="M.toml", required=True)
    one.add_argument("--out", metavar="M2.toml", required=True)
    with_effects(one)
    one = verb("effects", effects, "the catalogue of effects; with --check, whether they keep their contract")
    one.add_argument("names", metavar="NAME", nargs="*", help="only these")
    one.add_argument("--check", action="store_true", help="name every fault of these, of the folders', or of all")
    one.add_argument("--json", metavar="FILE", help="the same as JSON")
    with_effects(one)
    one = verb("new-effect", new_effect, "an effect's file to fill in, with its test")
    one.add_argument("name", metavar="NAME", help="in small letters joined by _")
    one.add_argument("--dir", metavar="DIR", default="effects", help="where they go (default: effects)")
    one.add_argument(
        "--from", dest="result", metavar="result.json", help="begin with what a discovery left unexplained"
    )
    with_effects(one)


def add(args: argparse.Namespace, progress: Progress) -> int:
    """Put an effect on a model's stack."""
    from models.model_file import effect_class, read_model, write_model

    check_outputs(args.out)
    effect = effect_class(args.effect)()
    before = read_model(args.model)
    model = before.add(effect)
    write_model(model, args.out)
    gone = [e.name() for e in before.effects if e.name() not in {k.name() for k in model.effects}]
    instead = f" (instead of {', '.join(gone)})" if gone else ""
    print(f"{args.out}: {', '.join(e.name() for e in model.effects)}{instead}")
    return DONE


def effects(args: argparse.Namespace, progress: Progress) -> int:
    """List the catalogue, or check effects against what every effect owes the workbench."""
    from models.contract import described, faults
    from models.model_file import catalogue, effect_class

    check_outputs(args.json)
    names = args.names or (list(args.own) if args.check and args.own else list(catalogue()))
    entries: list[dict[str, Any]] = []
    for name in dict.fromkeys(names):
        entry = described(effect_class(name))
        entries.append(entry)
        if args.check:
            progress(f"checking {name}")
            entry["faults"] = faults(effect_class(name))
            progress.close()
            print("\n".join([f"{name}: {fault}" for fault in entry["faults"]] or [f"{name}: no faults"]), flush=True)
            continue
        print(f"{name}  ({', '.join(entry['doors'])}{'; slot ' + entry['slot'] if entry['slot'] else ''})")
        print("\n".join(f"  {text}" for text in (entry["says"], entry["formula"]) if text))
        for key, meta in entry["parameters"].items():
            low, high = meta["bounds"]
            off = "only shapes it" if meta["off"] is None else f"off at {meta['off']:g}"
            print(f"    {key} = {meta['default']:g} [{meta['unit']}], {low:g} to {high:g}, {off}: {meta['source']}")
    if args.json:
        write_json(args.json, {"effects": entries})
    return FOUND if any(entry.get("faults") for entry in entries) else DONE


def new_effect(args: argparse.Namespace, progress: Progress) -> int:
    """Write an effect's file to fill in, and its test."""
    from sysid import new_effect as room

    room.checked_name(args.name)
    effect, test = room.write(args.name, args.dir, room.source_of(args.result, args.name) if args.result else None)
    print(f"{effect}: the effect, which runs as it is; fill in what it says")
    print(f"{test}: its test; run it with: python -m pytest {test}")
    print(f"check it with: sysid effects --check --effects {args.dir}")
    return DONE
