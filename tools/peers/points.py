"""Measure what others have on the same world, score it against the same reference, and set it beside clsim's points.

    python -m tools.peers.points SCENE --peers chain,manabe --quick

``chain`` is Mitsuba 3 at 32 spp, then the ICIP 2023 method in plain numpy; ``manabe`` an adaptive sampler that takes
256 spp and more. Prints the front of `clsim bench tradeoff` with the peers below it, and what clsim saves against each.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from clsim.bench.tradeoff.content_key import content_key
from clsim.bench.tradeoff.settings import Rendering
from clsim.bench.tradeoff.summary import VALUES, averages
from clsim.bench.tradeoff.sweep import Report, Sweep, TradeoffOptions, figures
from clsim.cli.commands.bench_tradeoff import default_cache
from clsim.cli.options.parse import resolution as parse_resolution
from clsim.cli.output.tradeoff_tables import front_row, front_table, table
from clsim.errors import require_choice
from clsim.events import EventBatch
from clsim.render import RenderOptions
from clsim.scene import World
from tools.peers import chain, manabe
from tools.peers.mitsuba_frames import require_mitsuba

LABELS = {
    "chain": f"Mitsuba 3 at {chain.SPP} spp, then ICIP 2023 in numpy",
    "manabe": f"Manabe et al. 2024, {manabe.FIRST} to {manabe.CAP} spp independent",
}


@dataclass(frozen=True)
class Peer:
    """One of ``LABELS`` with one seed; all of them have noise of its own in each frame and the rule ``frame``."""

    name: str
    seed: int

    def key(self) -> tuple[Any, ...]:
        """Return what its figures depend on besides what all points share."""
        try:
            mitsuba = version("mitsuba") if self.name == "chain" else None
        except PackageNotFoundError:
            mitsuba = None
        return ("peer", self.name, self.seed, mitsuba)

    def as_dict(self) -> dict[str, Any]:
        """Return what identifies it, as it stands in the results."""
        return {"peer": self.name, "seed": self.seed, "event_rule": "frame"}

    def check(self, world: World, file: Path | None) -> None:
        """Raise InputError if it cannot be measured on this world, or what it needs is not installed."""
        if self.name == "chain":
            require_mitsuba(world, file)

    def measure(
        self, world: World, file: Path | None, options: RenderOptions, on_work: Callable[[], None]
    ) -> tuple[EventBatch, dict[str, Any]]:
        """Return its events and its costs; ``file`` is the world's own; ``on_work`` is called now and then.

        Seed and length are those of ``options``.

        Raises:
            InputError: it cannot be measured on this world, or what it needs is not installed.
        """
        if self.name == "chain":
            options, config = replace(options, spp=chain.SPP), chain.chain_config(world.sensor)
            done = chain.run_chain(world, file, options, config, on_work)
            return done.events, done.costs()
        run = manabe.run_manabe(world, options, lambda samples: on_work())
        return run.events, {
            "paths": run.paths,
            "first_hit_rays_traced": 0,
            "render_cpu_s": run.render_cpu_s,
            "render_wall_s": run.render_wall_s,
            "detect_cpu_s": run.testing.cpu_s,
            "detect_wall_s": run.testing.wall_s,
            "undecided_share": run.undecided,
        }


def run_peers(options: TradeoffOptions, names: tuple[str, ...], report: Report) -> dict[str, Any]:
    """Return the results of ``clsim bench tradeoff`` with ``peers``, a row each and seed, and ``peer_settings``, means.

    What was measured before is not measured again.

    Raises:
        InputError: a peer is unknown, is not installed or cannot have the world, or the sweep cannot be run.
    """
    for name in names:
        require_choice("peers", name, tuple(LABELS))
    sweep = Sweep(options, report)
    file = Path(options.scene) if Path(options.scene).suffix.lower() == ".xml" else None
    peers = [Peer(name, seed) for name in dict.fromkeys(names) for seed in options.seeds]
    for peer in peers:
        if content_key(peer.key()) not in sweep.store:
            peer.check(sweep.world, file)
    results = sweep.run()
    missing = [peer for peer in peers if content_key(peer.key()) not in sweep.store]
    reference = sweep.reference(sweep.reference_options, "reference")
    for peer in missing:
        given = Rendering(1, "independent", peer.seed).options(sweep.fps, sweep.frames)
        events, costs = peer.measure(sweep.world, file, given, lambda name=peer.name: sweep.tell(name))
        sweep.store.append(content_key(peer.key()), figures(sweep.score(events, reference, "frame"), costs))
    rows = [peer.as_dict() | sweep.store[content_key(peer.key())] for peer in peers]
    return results | {"peers": rows, "peer_settings": summarise_peers(rows)}


def summarise_peers(points: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one row for each peer: means over seeds and standard deviations, ``label`` and ``seeds``."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for point in points:
        groups.setdefault(point["peer"], []).append(point)
    return [
        {"peer": name, "label": LABELS[name], "event_rule": group[0]["event_rule"]}
        | {"seeds": [point["seed"] for point in group]}
        | averages(group, ("peer", "seed", "event_rule"))
        for name, group in groups.items()
    ]


def saving(rows: list[dict[str, Any]], baseline: dict[str, Any]) -> dict[str, Any]:
    """Return which setting does as well as a baseline, by mean F1 and mean strict F1, in the least processor time.

    Keys are ``baseline``, ``setting`` (the label, None where nothing does as well) and ``factor``, the baseline's
    processor time over the setting's.
    """
    as_good = [row for row in rows if all(row[value] >= baseline[value] for value in VALUES)]
    best = min(as_good, key=lambda row: row["cpu_s"], default=None)
    entry = {"baseline": baseline["label"], "setting": None, "factor": None}
    if best is not None:
        entry |= {"setting": best["label"], "factor": baseline["cpu_s"] / best["cpu_s"]}
    return entry


def saving_text(entry: dict[str, Any]) -> str:
    """Return one ``saving`` as a list item."""
    if entry["setting"] is None:
        return f"- {entry['baseline']}: no setting has its F1 and its strict F1."
    share = f"1/{entry['factor']:.3g} of its CPU time"
    return f"- {entry['baseline']}: {entry['setting']} does as well in both scores for {share}."


def text(results: dict[str, Any]) -> str:
    """Return the front, the peers below it, and what is saved against each, as Markdown."""
    head, rows = front_table(results)
    below = [front_row(peer) for peer in results["peer_settings"]]
    saved = [saving_text(saving(results["settings"], peer)) for peer in results["peer_settings"]]
    return table(head, [*rows, *below]) + "\n\n" + "\n".join(saved)


def main() -> None:
    """Measure one scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--peers", default="chain,manabe")
    parser.add_argument("--quick", action="store_true", help="24 frames of 64x48 and a dozen points of clsim's")
    parser.add_argument("--resolution", type=parse_resolution)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--fps", type=float)
    parser.add_argument("--reference-spp", type=int)
    parser.add_argument("--cache", type=Path, default=default_cache())
    given = vars(parser.parse_args())
    names = tuple(given.pop("peers").split(","))
    print(text(run_peers(TradeoffOptions(**given), names, lambda what, done, total: print(what, flush=True))))


if __name__ == "__main__":
    main()
