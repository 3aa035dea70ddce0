"""The decision tree that users hold: the data of `BaseTree`, and the functions of this package as methods.

Methods import the modules they call when they are called: a tree that is only evaluated loads nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

from .actions import ActionSpec
from .base import BaseTree

if TYPE_CHECKING:
    from os import PathLike

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

    from .explain import Explanation, Norm
    from .verify.properties import PropertyLike, Verdict


@final
class DecisionTree(BaseTree):
    """A hard, axis-aligned decision tree that answers observations with actions.

    Its arguments, fields and exact semantics are those of `BaseTree`; the methods here change, prove, explain and
    write it. Each is a function of the same name in a module of `sympol.trees`.

    See Also:
        sympol.trees.edit: Change a tree by hand.
        sympol.trees.diff: Compare two trees.
        sympol.trees.export: Write a tree as a program or for another library.
    """

    def prune(
        self, *, bounds: bool = True, merge: bool = True, observations: ArrayLike | None = None
    ) -> DecisionTree:
        """Return the smaller tree that acts the same.

        Args:
            bounds: Whether only observations within the bounds of the space count.
            merge: Whether leaves with the same action may become one.
            observations: All observations there can be, [batch, features], where they can be listed. The tree then
                acts the same on these and may act differently on others.

        Returns:
            The pruned tree. See `sympol.trees.prune` for what is removed.

        Raises:
            ValueError: If ``observations`` are none, have another shape, or a group is not one-hot in them.
            TypeError: If ``observations`` are not numbers.
        """
        from .prune import prune, prune_on

        small = prune(self, bounds=bounds, merge=merge)
        return small if observations is None else prune_on(small, observations, merge=merge)

    def verify(self, *properties: PropertyLike) -> tuple[Verdict, ...]:
        """Prove or refute properties such as ``"when pole angle > 0.1 then action is push right"``.

        Args:
            properties: Each is a rule, a `sympol.trees.verify.Property`, or the path of a file of properties.

        Returns:
            A verdict for each property, with a counterexample where it does not hold.

        Raises:
            ValueError: If a rule cannot be parsed, or names something that the tree lacks.
        """
        from .verify import verify

        return verify(self, properties)

    def explain(
        self,
        observation: ArrayLike,
        *,
        immutable: Iterable[str | int] = (),
        norm: Norm = "l1",
        scale: Mapping[str | int, float] | None = None,
    ) -> Explanation:
        """Explain the action in one observation, and find what would change it.

        Args:
            observation: One observation, [features]; finite.
            immutable: Features and groups that no counterfactual may change, by name or position.
            norm: The distance between observations: ``"l1"``, ``"l0"`` or ``"linf"``.
            scale: What counts as a change by 1, by feature or group; 1 where it is not given.

        Returns:
            The path, the smallest sufficient reason, and the nearest counterfactual of every other action.

        Raises:
            ValueError: If the observation does not fit the tree or is not finite, or an option is not valid.
            TypeError: If the observation does not hold numbers.
        """
        from .explain import explain

        return explain(self, observation, immutable=immutable, norm=norm, scale=scale)

    def to_text(self, *, digits: int | None = None) -> str:
        """Write the tree as an indented listing.

        Args:
            digits: Significant digits of numbers; by default the fewest that give the same float32 back.

        Returns:
            The listing, which `from_text` reads.

        Raises:
            ValueError: If the tree is so deep that the listing would be too long.
        """
        from .text import to_text

        return to_text(self, digits=digits)

    def rules(self, *, digits: int | None = None) -> list[str]:
        """Write one sentence for each leaf.

        Args:
            digits: Significant digits of numbers; by default the fewest that give the same float32 back.

        Returns:
            The sentences, in the order of the listing.

        Raises:
            ValueError: If the tree is so deep that the sentences would be too long.
        """
        from .text import rules

        return rules(self, digits=digits)

    def plot(
        self,
        path: str | PathLike[str] | None = None,
        *,
        ax: Axes | None = None,
        digits: int = 4,
        highlight: ArrayLike | None = None,
    ) -> Figure:
        """Draw the tree.

        Args:
            path: Where to save the picture, as .svg, .pdf or .png; not at all by default.
            ax: Axes to draw on; by default those of a new figure of a fitting size.
            digits: Significant digits of thresholds.
            highlight: An observation [features] whose path stands out.

        Returns:
            The figure.

        Raises:
            ValueError: If ``path`` has another ending, the tree has too many nodes, or ``highlight`` is not one
                observation.
        """
        from .plot import plot

        return plot(self, path, ax=ax, digits=digits, highlight=highlight)

    def to_json(self) -> str:
        """Write the tree as strict JSON, the format in which it is stored (docs/tree-json.md).

        Returns:
            The text, which `from_json` reads.
        """
        from .serialize import to_json

        return to_json(self)

    @classmethod
    def from_json(cls, text: str) -> DecisionTree:
        """Read a tree that `to_json` wrote.

        Args:
            text: The JSON; it may come from an untrusted source.

        Returns:
            The same tree, bit for bit.

        Raises:
            ValueError: If the text is not JSON of this format, not a tree, or too large.
        """
        from .serialize import from_json

        return from_json(text, cls)

    @classmethod
    def from_text(
        cls, text: str, *, like: DecisionTree | None = None, actions: ActionSpec | None = None, **space: Any
    ) -> DecisionTree:
        """Read a tree that `to_text` wrote, or that was written by hand.

        Args:
            text: The listing, perhaps with a header that describes features and actions.
            like: A tree of the same features and actions, where the text has no header.
            actions: The actions, where there is neither a header nor such a tree.
            space: The observations, with ``actions``: the keyword arguments of `from_complete`.

        Returns:
            The tree, with the thresholds and actions of the text.

        Raises:
            ValueError: If the text is not a tree, or nothing describes features and actions.
        """
        from .text_parser import from_text

        return from_text(text, cls, like=like, actions=actions, **space)

    def to_html(self) -> str:
        """Write a self-contained web page on which to explore the tree.

        Returns:
            The page.

        Raises:
            ValueError: If the tree has more nodes or features than a page can show.
        """
        from .report import to_html

        return to_html(self)

    def export(self, to: str, **options: Any) -> str | bytes:
        """Write the tree in one of the formats of `sympol.trees.export.FORMATS`.

        Args:
            to: The format: ``"python"``, ``"c"``, ….
            options: Options of that format.

        Returns:
            Text, or bytes for a binary format.

        Raises:
            ValueError: If there is no such format, or the tree cannot be written in it.
        """
        from .export import format_of

        return format_of(to).write(self, **options)

    def to_python(self) -> str:
        """Write a Python program without dependencies.

        Returns:
            The source code. See `sympol.trees.export.python`.
        """
        from .export.python import to_python

        return to_python(self)

    @classmethod
    def from_sklearn(
        cls,
        estimator: DecisionTreeClassifier | DecisionTreeRegressor,
        actions: ActionSpec,
        *,
        feature_names: Sequence[str] | None = None,
        **space: Any,
    ) -> DecisionTree:
        """Convert a fitted tree of scikit-learn without changing a decision.

        Args:
            estimator: A fitted classifier, or a regressor for continuous actions.
            actions: The meaning of its predictions.
            feature_names: The names of its features; by default those it was fitted with, if any.
            space: Other keyword arguments of `from_complete` that describe observations.

        Returns:
            The tree, which acts as the estimator does on every finite observation.

        Raises:
            ValueError: If the estimator is not fitted, does not fit the arguments, or sends missing values left.
            TypeError: If it is not a decision tree of scikit-learn.
        """
        from .from_sklearn import from_sklearn

        return from_sklearn(estimator, actions, cls, feature_names=feature_names, **space)

    def to_sklearn(self, *, names: bool = True) -> DecisionTreeClassifier | DecisionTreeRegressor:
        """Convert to a fitted estimator of scikit-learn.

        Args:
            names: Whether the estimator knows the features' names.

        Returns:
            A classifier, or a regressor for continuous actions.
        """
        from .export.sklearn import to_sklearn

        return to_sklearn(self, names=names)

    def __str__(self) -> str:
        """Return the listing of `to_text`."""
        return self.to_text()
