"""HTML pages from Jinja2 templates that share one look (`base.html.j2`) and macros (`macros.html.j2`)."""

import jinja2

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("fastac", "."),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def render(template: str, **values) -> str:
    """The page of a template below fastac/, such as "report/build.html.j2", with these values.

    Text is escaped, and a value that the template lacks raises jinja2.UndefinedError.
    """
    return _TEMPLATES.get_template(template).render(**values)
