"""The teacher's road where all of the world is known: what to do is looked up, and no teacher has to be trained.

The best policy without memory is a table (`sympol.search.best_lookup`); a tree that says the same is grown by CART and
pruned by return, node by node.
"""

from __future__ import annotations

import time

from ...distill.cart import fit_cart
from ...envs.spec import EnvSpec
from ..best_lookup import best_lookup
from ..evaluators.tabular import TableArena
from .candidates import Found, keep
from .context import Site, chained, part
from .front import Spent

SEARCHING = 0.5
"""Of the share, at most, for the table."""
FITS = 4
"""Trees of one table: CART has a choice among splits that are equally good."""


def is_known(spec: EnvSpec) -> bool:
    """Whether an environment is a world that fits in tables."""
    return spec.state_graph() is not None


def looked_up(site: Site) -> None:
    """Go the road; what is found is in the site's folder then."""
    began = time.perf_counter()
    table = best_lookup(TableArena(site.spec, site.seed), budget=part(site.share, SEARCHING), seed=site.seed)
    cost = Spent(env_steps=table.steps, seconds=time.perf_counter() - began)
    trees = (
        fit_cart(table.observations, table.actions, site.spec, depth=None, seed=seed) for seed in range(FITS)
    )
    found: list[Found] = []
    for tree in dict.fromkeys(trees):
        found += chained(site, tree, "lookup", found[-1].spent if found else cost)
    keep(site.folder, found, finished=True)
