"""The registry of environments: find one by id, object or function, and describe it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any, get_args

import gymnasium

from ..trees.groups import Group
from .adapters import all_ids, built_in, lists
from .adapters.gymnasium import make
from .capabilities import NativeEngine
from .diagnostics import warn_of_environment
from .entries import REGISTERED, Entry, Factory
from .env import Env
from .jax_protocol import kept_to_protocol
from .libraries import is_library_id
from .named import import_named, named_env
from .names import NAMES, known_names
from .on_host import OnHost
from .origin import Origin, Wrapping
from .recorded import Recorded
from .remake import make_wrapped
from .sources import Source, is_factory, open_source
from .spaces import Features, action_spec
from .spec import Backend, EnvSpec, HostFactory, not_listed
from .user_code import absolute, is_file, short, split


def register(
    name: str,
    env: Env | Factory | None = None,
    *,
    host: HostFactory | None = None,
    feature_names: Sequence[str] | None = None,
    action_names: Sequence[str] | None = None,
    groups: Sequence[Group] | None = None,
) -> None:
    """Give an environment a name, or give names to the features and actions of one.

    A later registration replaces an earlier one. Functions are called with the user's ``env_kwargs``.

    Args:
        name: The id.
        env: An environment written in JAX, or a function that makes one or a Gymnasium environment. Leave it out to
            name the features and actions of an id of Gymnasium's.
        host: A function that makes the counterpart in Gymnasium of an environment in JAX; policies are trained on the
            one and evaluated on the other. By default it is Gymnasium's own environment of this id, if there is one.
        feature_names: Names of the features.
        action_names: Names of the actions, or of the components of an action.
        groups: Features that are one-hot together.
    """
    REGISTERED[name] = Entry(env, host, feature_names, action_names, groups)


def resolve(
    env: str | gymnasium.Env | Env | Factory,
    *,
    env_kwargs: Mapping[str, Any] | None = None,
    feature_names: Sequence[str] | None = None,
    action_names: Sequence[str] | None = None,
    groups: Sequence[Group] | None = None,
    backend: Backend = "auto",
    wrappers: Sequence[Wrapping] = (),
    require_installed: bool = True,
    recorded: Recorded | None = None,
) -> EnvSpec:
    """Find an environment by id, object or factory, and describe it.

    Args:
        env: An id, an environment, or a function that makes one. An object is played itself. The name of a class, a
            function or an object, or an id that is registered there, follows its module or its file, as in
            ``"my_package:Tank"`` or ``"plants/tank.py:Tank"``, which is imported.
        env_kwargs: Arguments to make the environment with, as those of `gymnasium.make`.
        feature_names: Names of the features; by default the registered ones, the environment's own, or ``x[0]``.
        action_names: Names of the actions; by default the registered ones, the environment's own, or ``action 0``.
        groups: Features that are one-hot together; by default the registered ones or the environment's own.
        backend: The form to train on: ``"jax"``, ``"native"`` (machine code) or ``"host"`` (Gymnasium). ``"auto"`` is
            the first of these that exists, machine code only where Numba is installed.
        wrappers: Wrappers of Gymnasium to put around an environment named by its id, from the innermost.
        require_installed: Whether backend ``"native"`` is refused where Numba is missing; otherwise only training
            fails.
        recorded: The spaces that a run's folder has of an id. Then an environment of Gymnasium is not made until it is
            played.

    Returns:
        The description of the environment.

    Raises:
        UnknownEnvironment: No environment has this id; the message offers near ones.
        MissingExtra: The environment needs a package that is not installed.
        ValueError: A space is unsupported, names or groups do not fit, the environment does not take the arguments,
            or it lacks the backend.
        TypeError: The object is no environment.
    """
    if backend not in get_args(Backend):
        raise ValueError(f"backend must be one of {', '.join(get_args(Backend))}, got {backend!r}")
    kwargs = dict(env_kwargs or {})
    env = absolute(env) if isinstance(env, str) else env
    entry = _entry(env) if isinstance(env, str) and not wrappers else Entry()
    source = _open(env, entry, kwargs, tuple(wrappers), recorded)
    name, jax_env = short(env) if isinstance(env, str) else source.name, source.jax_env
    make_host = _host_of(source, entry, env if isinstance(env, str) else name, kwargs)
    if backend == "jax" and jax_env is None:
        raise ValueError(f"{name} is not written in JAX; use backend='host' or 'auto'")
    in_jax = jax_env is not None and backend in ("auto", "jax")
    native, speed_hint = None, ""
    if not in_jax:
        native, speed_hint = _native(name, None if kwargs else entry.native, backend, require_installed)
    known = known_names(source.example, name)

    def own(what: str, given: Any) -> Any:
        offers = (given, getattr(entry, what), _carried(source.example, what), known.get(what))
        return next((offer for offer in offers if offer is not None), None)

    observation_space, action_space = source.example.observation_space, source.example.action_space
    spec = EnvSpec(
        name=name,
        env=kept_to_protocol(jax_env) if jax_env is not None and in_jax else None,
        make_host=make_host,
        observation_space=observation_space,
        action_space=action_space,
        features=Features.of(
            observation_space,
            own("feature_names", feature_names),
            own("groups", groups),
            _integers(source.example, known) if recorded is None else recorded.integers,
        ),
        actions=action_spec(
            action_space, own("action_names", action_names), _carried(source.example, "action_options")
        ),
        max_episode_steps=source.max_episode_steps,
        has_one_copy=source.has_one_copy,
        native=native,
        speed_hint=speed_hint,
        drawing=built_in(name).drawing,
        all_observations=getattr(jax_env, "all_observations", not_listed),
        find_origin=source.find_origin,
        find_copies=source.find_copies,
        vector=source.vector,
    )
    warn_of_environment(source.example, name, len(spec.features.names))
    return spec


def _open(
    env: Any, entry: Entry, kwargs: dict[str, Any], wrappers: tuple[Wrapping, ...], recorded: Recorded | None
) -> Source:
    """Look at an environment in the form that training prefers; say how it was made, as a run keeps it."""
    if recorded is not None and entry.env is None and _is_listed(env):
        source = Source(recorded, _later(env, kwargs, wrappers, recorded))
    elif wrappers:
        inner = resolve(env, env_kwargs=kwargs, backend="host").make_host
        source = open_source(partial(make_wrapped, inner, wrappers), {}, _remake)
    elif not isinstance(env, str):
        source = open_source(env, kwargs, _remake)
    elif entry.env is not None and not (kwargs and not is_factory(entry.env)):
        source = open_source(entry.env, kwargs, _remake)
    else:  # an environment in JAX that is no function takes no arguments, and Gymnasium's may
        source = open_source(entry.host or partial(make, env), kwargs, _remake)
    name = env if isinstance(env, str) else source.name
    if isinstance(env, str) or (
        name in REGISTERED and REGISTERED[name].env is env
    ):  # its name makes it again
        file = split(name)[0] if is_file(name.rpartition(":")[0]) else ""
        source = source._replace(find_origin=partial(Origin.of_arguments, kwargs, wrappers, file))
    if _is_replaced(name):
        not_kept = f"where {name} had been registered anew"
        source = source._replace(find_origin=partial(Origin, kwargs, wrappers, not_kept))
    return source


def _is_listed(env_id: str) -> bool:
    """Return whether an environment exists, as far as that can be told without importing anything."""
    return env_id.rpartition(":")[2] in gymnasium.registry or lists(env_id)


def _later(
    env_id: str, kwargs: dict[str, Any], wrappers: tuple[Wrapping, ...], recorded: Recorded
) -> HostFactory:
    """Return a function that makes an environment, which is compared with what was recorded when the first is made."""

    def make_host() -> HostFactory:
        found = resolve(env_id, env_kwargs=kwargs, wrappers=wrappers, backend="host")
        for space in ("observation_space", "action_space"):
            was, now = getattr(recorded, space), getattr(found, space)
            if was != now:
                raise ValueError(
                    f"{env_id} has changed since this run was saved: its {space} was {was} and is {now}; to use it "
                    f"as it is now, name it: env={env_id!r}, or --env {env_id}"
                )
        return found.make_host

    return _Later(make_host)


class _Later:
    """A function that makes an environment, found when it is first called or sent to another process."""

    def __init__(self, find: Callable[[], HostFactory]) -> None:
        self._find = cache(find)

    def __call__(self, **options: Any) -> gymnasium.Env:
        return self._find()(**options)

    def __reduce__(self) -> tuple[Any, ...]:
        return identity, (self._find(),)


def identity(make: HostFactory) -> HostFactory:
    """Return the function; this is what a worker process makes of a `_Later`."""
    return make


def _entry(env_id: str) -> Entry:
    """Return what is known of an id: what the user registered, else what an adapter has.

    For ``module:name`` the module is imported, and what it registered by this name counts, else what it has of it.
    """
    module, name = split(env_id)
    if module and env_id not in REGISTERED:
        import_named(module)
        entry = _entry(name)
        if isinstance(entry.host, partial) and entry.host.func is make:
            if name not in REGISTERED and not _is_listed(name):
                return Entry(named_env(module, name))
            return entry._replace(host=partial(make, env_id))  # so that each copy imports the module, too
        return entry
    ours = built_in(env_id)
    if _is_replaced(env_id):  # what Gymnasium makes of it is not what our forms do
        ours = Entry(host=partial(make, env_id))
    given = REGISTERED.get(env_id)
    if given is None:
        return ours
    if given.env is None and given.host is None:  # only names, for what Gymnasium makes
        return given._replace(host=ours.host, native=ours.native)
    return given


def _carried(example: gymnasium.Env | Env | Recorded, what: str) -> Any:
    """Return an attribute of an environment, or of the one inside the wrappers that `gymnasium.make` itself adds."""
    found = getattr(example, what, None)
    if found is None and isinstance(example, gymnasium.Env) and (spec := example.spec) is not None:
        found = None if spec.additional_wrappers else getattr(example.unwrapped, what, None)
    return found


def _integers(example: Any, known: Mapping[str, Any]) -> Sequence[int]:
    """Return the positions of features that are whole numbers, as the environment or our table of names says."""
    carried = _carried(example, "integers")
    return known.get("integers", ()) if carried is None else carried


def _is_replaced(env_id: str) -> bool:
    """Return whether an id of Gymnasium's or ours now means another environment: registered anew, or altered."""
    ours = built_in(env_id)
    if ours.env is not None and REGISTERED.get(env_id, Entry()).env not in (None, ours.env):
        return True
    spec = gymnasium.registry.get(env_id)
    if spec is None or (ours.env is None and env_id not in NAMES):
        return False
    limit = getattr(ours.env, "max_episode_steps", None)
    return (
        not isinstance(spec.entry_point, str)
        or not spec.entry_point.startswith(ours.entry_points)
        or bool(spec.additional_wrappers)
        or (limit is not None and (spec.max_episode_steps != limit or bool(spec.kwargs)))
    )


def _host_of(source: Source, entry: Entry, name: str, kwargs: dict[str, Any]) -> HostFactory:
    """Return what makes the form in Gymnasium, on which policies are evaluated.

    What exists in JAX alone is its own form in Gymnasium.
    """
    if source.jax_env is None:
        assert source.make_host is not None
        return source.make_host
    if entry.host is not None:
        return partial(entry.host, **kwargs)
    is_known = not is_library_id(name) and name.rpartition(":")[2] in gymnasium.registry
    return partial(make, name, **kwargs) if is_known else partial(OnHost, source.jax_env)


def _native(
    name: str, engine: NativeEngine | None, backend: Backend, require_installed: bool
) -> tuple[NativeEngine | None, str]:
    """Return the machine code to train on, if any, and what to install for faster training."""
    if backend == "native" and engine is None:
        ours = [env_id for env_id in all_ids() if built_in(env_id).native is not None]
        raise ValueError(
            f"{name} cannot be stepped by our own machine code, which has {' and '.join(ours)}, by id and "
            "without env_kwargs; use backend='host' or 'auto'"
        )
    if engine is None:
        return None, ""
    if engine.is_installed():
        return (None if backend == "host" else engine), ""
    if backend != "native":
        return None, engine.install_hint
    if require_installed:
        engine.require_installed()
    return engine, ""


def _remake(env_id: str, kwargs: Mapping[str, Any]) -> gymnasium.Env:
    """Make an environment by its id and arguments, as loading a run does."""
    return resolve(env_id, env_kwargs=kwargs, backend="host").make_host()
