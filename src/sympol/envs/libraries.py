"""The libraries of environments in JAX that ids may name, ``library:name``; importing this imports none of them."""

from __future__ import annotations

ADAPTER_OF = {
    "brax": "sympol.envs.adapters.brax:Brax",
    "craftax": "sympol.envs.adapters.craftax:Craftax",
    "gymnax": "sympol.envs.adapters.gymnax:Gymnax",
    "jumanji": "sympol.envs.adapters.jumanji:Jumanji",
    "navix": "sympol.envs.adapters.navix:Navix",
    "pgx": "sympol.envs.adapters.pgx:Pgx",
    "playground": "sympol.envs.adapters.playground:Playground",
}
"""The beginning of an id, which is also the extra that installs the library, and the adapter for it."""


def is_library_id(env_id: str) -> bool:
    """Return whether an id names an environment of one of these libraries.

    Args:
        env_id: The id.

    Returns:
        True if it does; then no module of the user's is imported for it.
    """
    return env_id.partition(":")[0] in ADAPTER_OF and ":" in env_id
