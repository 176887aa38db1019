from seqrsm.cli.notebook import Campaign as Campaign
from seqrsm.cli.results import Fit as Fit

__version__: str
