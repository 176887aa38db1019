"""Sequential response-surface campaigns to find the best design of a microwave remote sensor.

The packages follow the method of RSL TR 380-1: ``scene``, ``scattering`` and ``sensor`` feed ``simulate``, whose images
``score`` turns into utilities; ``design`` and ``fit`` describe the response surface; ``propose`` and ``decide`` choose
the next runs and when to stop; ``campaign`` joins the two sides; ``report`` and ``cli`` present the result.

In a notebook::

    c = seqrsm.Campaign("mine")
    plan = c.propose(4)
    c.ingest(plan.assign(score=measured))
    c.fit()

See `seqrsm.Campaign`.
"""

__version__ = "0.9.1"
_NOTEBOOK = ("Campaign", "Fit")


def __getattr__(name: str) -> object:
    """``seqrsm.Campaign`` and ``seqrsm.Fit``, loaded at their first use."""
    if name not in _NOTEBOOK:
        raise AttributeError(f"module 'seqrsm' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module("seqrsm.cli.notebook"), name)


def __dir__() -> list[str]:
    return [*globals(), *_NOTEBOOK]  # what a notebook completes
