"""Tells the documentation's reader of source what a msgspec Struct's annotated fields are: the parameters of its constructor."""

from typing import Any

from griffe import Attribute, Class, Extension, Function, Parameter, ParameterKind, Parameters


class Structs(Extension):
    """Gives every Struct an `__init__`, as the reader does by itself for dataclasses."""

    def on_class(self, *, cls: Class, **_: Any) -> None:
        """Called when a class with all its members has been read."""
        if "__init__" in cls.members or cls.labels & {"dataclass"} or cls.decorators or not cls.bases:
            return
        fields = [m for m in cls.members.values() if isinstance(m, Attribute) and "instance-attribute" in m.labels]
        parameters = [
            Parameter(name=m.name, annotation=m.annotation, kind=ParameterKind.keyword_only, default=m.value) for m in fields
        ]
        this = Parameter(name="self", annotation=None, kind=ParameterKind.positional_or_keyword, default=None)
        if fields:
            init = Function("__init__", parent=cls, parameters=Parameters(this, *parameters), returns="None")
            cls.set_member("__init__", init)
