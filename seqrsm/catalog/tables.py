"""What Tables A.1 to A.39 of RSL TR 380-1 hold: tables, entries, platforms, and the ranges read from their print."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Range:
    """A printed range; a side that is not printed is None ("> 30" has no upper side).

    Attributes
    ----------
    low, high : float or None
        Ends, both included, in the unit the field's name tells. low == high for a single printed number.
    """

    low: float | None
    high: float | None

    def __str__(self) -> str:
        low, high = (None if end is None else f"{float(f'{end:.4g}'):.10g}" for end in (self.low, self.high))
        if low is None or high is None:
            return f"< {high}" if low is None else f"> {low}"
        return low if low == high else f"{low} to {high}"


@dataclass(frozen=True, slots=True)
class Table:
    """One of Tables A.1 to A.39.

    Attributes
    ----------
    number : str
        "A.1" to "A.39".
    kind : {"resolution", "frequency", "requirements", "platform"}
        A.1-A.7, A.8-A.15, A.16-A.20, A.21-A.39.
    listed_title : str
        Title in the report's list of tables; "" for the platforms, which it does not list one by one.
    title : str
        Title over the table itself, as printed; "" when the page is missing (A.26).
    note : str
        Damage and contradictions.
    n_entries : int
        Applications, requirements, or the one platform, that the table states.
    n_none : int
        User categories or bands for which the table says "None".
    """

    number: str
    kind: str
    listed_title: str
    title: str
    note: str
    n_entries: int
    n_none: int


@dataclass(frozen=True, slots=True)
class Entry:
    """One application of Tables A.1 to A.20, as printed, with the numbers read from the print.

    Attributes
    ----------
    table : str
        Number of the table, "A.16".
    number : int
        Place in the table, from 1.
    system : {"active", "passive"}
        Radar or radiometer. Tables A.16 to A.20 are "radar parameters" by the report's own words.
    category : str
        User category printed over the entry; for A.16 to A.20 the subject of the table; "" where none is printed.
    numeral : str
        Roman numeral printed before the category, or before the application where there is no category.
    group : str
        Heading the application stands under in Tables A.16 to A.20.
    application : str
        As printed; "None" where the table says that nothing was found; "" where the print is lost.
    reading : str
        What an obviously damaged application means; "" otherwise.
    heading : str
        Resolution class or band over the entry, as printed (A.1 to A.15).
    band : str
        Letter of the band (A.8 to A.15).
    wavelength, frequency : str
        As printed. Tables A.16 to A.20 print frequencies in the column Wavelength (cm): ``wavelength`` holds it.
    wavelength_cm : tuple of Range
        Wavelengths printed [cm].
    frequency_ghz : tuple of Range
        Frequencies printed [GHz], or those of the printed wavelengths or bands; empty: no number is printed.
    n_frequencies : str
        How many frequencies at once, where printed: "2", "1 or 2", "several".
    resolution_class_m : Range or None
        Resolution class of Tables A.1 to A.7 [m]; for the passive part of A.7 the two sides of the cell.
    resolution_wanted, resolution_accepted : str
        Columns Desire and Accept, as printed.
    resolution_wanted_m, resolution_accepted_m : float or None
        The same [m].
    polarization : str
        As printed.
    channels : tuple of tuple of str
        Sets of channels asked for, one or another; cross is HV. Empty: the print names no channel.
    nadir_angle : str
        As printed.
    nadir_angle_deg : tuple of Range
        Angles from the vertical [deg].
    best_nadir_angle_deg : float or None
        Angle printed as best [deg].
    auxiliary : str
        Column Auxiliary (revisit interval), as printed.
    revisit_days : Range or None
        Revisit interval [days], where it is printed as a number.
    note : str
        Damage, contradictions, and how the entry was read.
    """

    table: str
    number: int
    system: str
    category: str
    application: str
    numeral: str = ""
    group: str = ""
    reading: str = ""
    heading: str = ""
    band: str = ""
    wavelength: str = ""
    frequency: str = ""
    wavelength_cm: tuple[Range, ...] = ()
    frequency_ghz: tuple[Range, ...] = ()
    n_frequencies: str = ""
    resolution_class_m: Range | None = None
    resolution_wanted: str = ""
    resolution_accepted: str = ""
    resolution_wanted_m: float | None = None
    resolution_accepted_m: float | None = None
    polarization: str = ""
    channels: tuple[tuple[str, ...], ...] = ()
    nadir_angle: str = ""
    nadir_angle_deg: tuple[Range, ...] = ()
    best_nadir_angle_deg: float | None = None
    auxiliary: str = ""
    revisit_days: Range | None = None
    note: str = ""

    @property
    def is_none(self) -> bool:
        """Whether the entry is the table's statement that nothing was found."""
        return self.application == "None"

    @property
    def name(self) -> str:
        """Application with the heading it stands under, for people; the reading where the print is lost."""
        own = self.application or self.reading
        return f"{self.group}: {own}" if self.group and self.application else own


@dataclass(frozen=True, slots=True)
class PlatformItem:
    """One printed line of a platform table.

    Attributes
    ----------
    item : str
        Name of the line: Altitude, Pointing Acc., Size, Weight, Power, Telemetry, Data Storage, or a remark's name.
    printed : str
        What stands there; "" where the line is empty in print.
    note : str
        Damage, contradictions, and how the line was read.
    """

    item: str
    printed: str
    note: str


@dataclass(frozen=True, slots=True)
class Platform:
    """A spacecraft, or a set of general limits, of Tables A.21 to A.39.

    Attributes
    ----------
    table : str
        Number of the table.
    spacecraft : str
        As printed.
    reading : str
        What an obviously damaged name means; "" otherwise.
    items : tuple of PlatformItem
        Every printed line, empty ones too.
    note : str
        Remarks on the whole table.
    """

    table: str
    spacecraft: str
    reading: str
    items: tuple[PlatformItem, ...]
    note: str

    @property
    def name(self) -> str:
        """Name for people."""
        return self.reading or self.spacecraft


@dataclass(frozen=True, slots=True)
class Catalog:
    """Tables A.1 to A.39.

    Attributes
    ----------
    tables : tuple of Table
        All 39, A.26 (page missing) included.
    entries : tuple of Entry
        Everything Tables A.1 to A.20 state, the statements "None" included, in printed order.
    platforms : tuple of Platform
        Tables A.21 to A.39 without A.26.
    """

    tables: tuple[Table, ...]
    entries: tuple[Entry, ...]
    platforms: tuple[Platform, ...]

    def of(self, table: Table) -> tuple[Entry, ...] | tuple[Platform, ...]:
        """What a table states: its entries, or the one platform."""
        entries = tuple(entry for entry in self.entries if entry.table == table.number)
        return entries or tuple(platform for platform in self.platforms if platform.table == table.number)
