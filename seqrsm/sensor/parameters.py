"""Every parameter of the two sensors, a row each, and all that is read from the rows.

A row says by which name ``campaign.toml`` knows the parameter, which field of the configuration it sets, its unit, its
limits or levels, what it is, and why a campaign cannot vary it where it cannot. From the rows come the names taken as
factors and under ``[simulator.fixed]``, the conversion of what is written there, the check of every value alone, the
units and labels of reports, and what ``seqrsm parameters`` prints. Defaults stand with the fields, in
`seqrsm.sensor.radar.RadarConfiguration` and `seqrsm.sensor.radiometer.RadiometerConfiguration`. A new parameter is a
field there and a row here; one that a campaign is to vary, and could not, loses the reason in its row.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from types import MappingProxyType
from typing import Any, Final, Literal, TypeVar

from seqrsm.errors import ConfigurationError, Problem
from seqrsm.sensor.antenna import pattern_file_text, pattern_points

Kind = Literal["number", "whole", "word", "channels", "pattern", "function", "file", "days"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a sensor.

    Attributes
    ----------
    name : str
        In ``campaign.toml``.
    field : str
        Of the configuration; ``[simulator.fixed]`` takes this name, too.
    kind : {"number", "whole", "word", "channels", "pattern", "function", "file", "days"}
        A number; a whole number; one of `levels`; some of `levels`, joined by "+"; points of an antenna pattern (see
        `seqrsm.sensor.antenna.pattern_points`); one of `levels` or a function of the user's, "module:function"; the
        path of a file; days of the year, joined by "+".
    what : str
        What it is, in a phrase.
    unit : str
        "" for a pure number, and where there is no number.
    low, high : float
        Least and largest value [`unit`].
    levels : tuple of str
        All that a word may be; the channels that there are; the functions that have a name.
    values : tuple of float
        All that a number may be which is not free between its limits [`unit`].
    why_fixed : str
        Why a campaign cannot vary it, "" where it can.
    said : str
        Its name in a report, "" for `name` without underscores and without the suffix that tells the unit.
    """

    name: str
    field: str
    kind: Kind
    what: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    levels: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    why_fixed: str = ""
    said: str = ""

    @property
    def numeric(self) -> bool:
        """Whether its values are numbers."""
        return self.kind in ("number", "whole")

    @property
    def continuous(self) -> bool:
        """Whether it takes every number between its limits."""
        return self.kind == "number" and not self.values

    @property
    def allowed(self) -> str:
        """What it may be, in words."""
        levels = ", ".join(self.levels or [f"{value:g}" for value in self.values])
        if self.numeric and not self.values:
            whole = "whole " if self.kind == "whole" else ""
            return f"a {whole}number from {self.low:g} to {self.high:g} {self.unit}".rstrip()
        if self.kind == "channels":
            return f"one or more of {levels}, each once, as in {self.levels[0]}+{self.levels[1]}"
        if self.kind == "days":
            return 'days of the year, as in "120+150+200"'
        if self.kind == "pattern":
            return 'look angles [deg] and gains [dB], as in "0:-20, 40:0, 70:-3"'
        if self.kind == "function":
            named = f"{levels}, or " if levels else ""
            return f'{named}a function of yours, "package.module:function"'
        return "the path of a file" if self.kind == "file" else f"{levels} {self.unit}".rstrip()

    @property
    def label(self) -> str:
        """Its name as people read it; no two of a sensor have the same."""
        return self.said or self.name.removesuffix(f"_{self.unit.lower().replace('/', '_')}").replace("_", " ")

    def problem(self, value: object) -> Problem | None:
        """What makes a value of the field's type impossible, whatever the other parameters are; None: nothing."""
        remedy = f"Give {self.allowed}"
        if self.numeric:
            number = value if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
            if not self.low <= number <= self.high:
                return Problem("out of range", f"{remedy}: {self.what}", field=self.name, value=value)
            if (self.kind == "whole" and number != round(number)) or (self.values and number not in self.values):
                return Problem("not one of its values", remedy, field=self.name, value=value)
        if self.kind == "channels":
            known = isinstance(value, tuple) and bool(value) and len(set(value)) == len(value)
            if not known or not set(value) <= set(self.levels):  # type: ignore[call-overload]
                written = "+".join(map(str, value)) if isinstance(value, tuple) else value
                return Problem("not a set of channels", remedy, field=self.name, value=written)
        elif self.kind == "function":
            if value and value not in self.levels and ":" not in str(value):
                return Problem("unknown", remedy, field=self.name, value=value)
        elif self.levels and value not in self.levels:
            return Problem("unknown", f"Known: {self.allowed}", field=self.name, value=value)
        return None

    def converted(self, written: float | str, problems: list[Problem]) -> object:
        """A value as the field holds it, from that of ``campaign.toml``; why it cannot be is added to ``problems``."""
        if self.numeric:
            try:
                if isinstance(written, bool):
                    raise ValueError
                number = float(written)
            except (TypeError, ValueError):
                problems.append(Problem("not a number", f"Give {self.allowed}", field=self.name, value=written))
                return written
            return int(number) if self.kind == "whole" and number == round(number) else number
        text = str(written)
        if self.kind == "channels":
            return tuple(part.strip() for part in text.split("+"))
        if self.field != "pattern_table":
            return text
        try:
            return pattern_points(pattern_file_text(text, problems) if self.kind == "file" else text)
        except ConfigurationError as error:
            problems.extend(error.problems)
            return ()

    def level_problems(self, written: float | str) -> list[Problem]:
        """What makes a value of ``campaign.toml`` impossible as the level of a factor."""
        problems: list[Problem] = []
        if self.kind == "function" and written not in self.levels:
            text = f"a function of yours is no level: {_CODE}" if ":" in str(written) else "unknown"
            remedy = f"Known: {', '.join(self.levels)}; a function of yours may stand in [simulator.fixed]"
            return [Problem(text, remedy, field=self.name, value=written)]
        # Levels are told apart as they are written: no blanks in "HH+HV".
        value = tuple(str(written).split("+")) if self.kind == "channels" else self.converted(written, problems)
        found = None if problems else self.problem(value)
        return problems if found is None else [found]


_FILE: Final = "what a file holds may change behind its name, and runs of one level would be no repeats"
_CODE: Final = "what a function does may change behind its name, and runs of one level would be no repeats"


def _number(
    field: str,
    unit: str,
    low: float,
    high: float,
    what: str,
    *,
    name: str = "",
    values: tuple[float, ...] = (),
    said: str = "",
) -> Parameter:
    return Parameter(name or field, field, "number", what, unit, low, high, values=values, said=said)


def _whole(field: str, low: float, high: float, what: str) -> Parameter:
    return Parameter(field, field, "whole", what, "", low, high)


def _word(field: str, levels: tuple[str, ...], what: str) -> Parameter:
    return Parameter(field, field, "word", what, levels=levels)


def _file(name: str, what: str, *, field: str = "", why_fixed: str = _FILE) -> Parameter:
    return Parameter(name, field or name, "file", what, why_fixed=why_fixed)


def _table(*rows: Parameter) -> Mapping[str, Parameter]:
    return MappingProxyType({row.name: row for row in rows})


_PATTERN_FILE: Final = f"{_FILE}; give the patterns themselves, as levels of pattern_table"
_RECEIVERS: Final = ("linear", "square_law", "saturation", "compression", "agc")

RADAR: Final = _table(
    _number("frequency_ghz", "GHz", 0.1, 100.0, "carrier frequency", name="frequency"),
    Parameter(
        "polarization", "channels", "channels", "channels imaged together, transmitted and received; R is circular",
        levels=("HH", "HV", "VV", "VH", "RH", "RV"),
    ),
    _number("resolution_m", "m", 0.05, 1e5, "side of the final resolution cell on the ground", name="resolution"),
    _number("bandwidth_mhz", "MHz", 1e-3, 1e4, "bandwidth of the pulse", name="bandwidth"),
    _number("peak_power_w", "W", 1e-6, 1e9, "peak transmitted power", name="peak_power"),
    _number(
        "depression_angle_deg", "deg", 0.05, 89.95, "angle below the horizontal to the centre of the scene",
        name="depression_angle",
    ),
    _number("altitude_m", "m", 1.0, 2e6, "height of the flight line above the zero of the scene's elevations"),
    _number("looks", "", 1.0, 1e6, "samples averaged in a final cell, all there are by default"),
    _number("heading_deg", "deg", -360.0, 360.0, "direction of flight from north; the radar looks to the right"),
    _word("scan", ("slar", "ppi"), "side-looking along a flight line, or an antenna that rotates over one point"),
    _number("antenna_east_m", "m", -1e6, 1e6, "place of a rotating antenna, east of the middle of the scene"),
    _number("antenna_north_m", "m", -1e6, 1e6, "place of a rotating antenna, north of the middle of the scene"),
    _number("antenna_length_m", "m", 1e-2, 1e3, "length of the antenna along the track"),
    _number("antenna_gain_db", "dB", -10.0, 80.0, "peak one-way gain of the antenna over isotropic"),
    _word("aperture", ("synthetic", "real"), "azimuth cell of one look: half the antenna's length, or the beam"),
    _number("azimuth_beamwidth_deg", "deg", 1e-3, 90.0, "half-power beamwidth along the track, wavelength/length by "
            "default"),
    _word(
        "elevation_pattern", ("isotropic", "cosecant_squared", "sinc_squared", "table"),
        "how the gain falls off its peak with the look angle",
    ),
    _number(
        "boresight_depression_deg", "deg", 0.0, 90.0, "depression angle of the antenna's peak, that of the scene by "
        "default",
    ),
    _number("elevation_beamwidth_deg", "deg", 0.1, 180.0, "half-power width of the beam in elevation"),
    Parameter("pattern_table", "pattern_table", "pattern", 'points of the elevation pattern "table"'),
    _file("pattern_file", "CSV file of the same points", field="pattern_table", why_fixed=_PATTERN_FILE),
    _number("pulse_length_us", "us", 1e-3, 1e5, "length of the transmitted pulse"),
    _number("prf_hz", "Hz", 1.0, 1e6, "pulses a second, all transmit polarizations together"),
    _number("speed_m_s", "m/s", 1.0, 1e4, "ground speed"),
    _number("noise_figure_db", "dB", 0.0, 40.0, "noise figure of the receiver"),
    _number("loss_db", "dB", 0.0, 60.0, "two-way loss of antenna feed and processing"),
    _number("zenith_loss_db", "dB", 0.0, 30.0, "one-way loss of the atmosphere straight down"),
    _number("pixel_m", "m", 0.05, 1e5, "side of a pixel on the ground, the resolution by default"),
    _word("range_format", ("ground", "slant"), "spacing of the image rows: in ground range, or in slant range"),
    _number("near_incidence_deg", "deg", 0.0, 89.9, "incidence angle on flat ground at the near edge of the swath"),
    _number("far_incidence_deg", "deg", 0.1, 90.0, "incidence angle on flat ground at the far edge of the swath"),
    _word("earth", ("curved", "flat"), "sphere or plane under the elevations"),
    _word("fading", ("gamma", "gaussian", "none"), "law of the fading of a pixel"),
    Parameter("receiver", "receiver", "function", "transfer function M of the receiver", levels=_RECEIVERS),
    _number("receiver_level_db", "dB", -100.0, 100.0, "level of the receiver over flat ground of sigma0 = 1"),
    _number("agc_length_m", "m", 1.0, 1e6, "flight path over which the automatic gain follows the echo"),
    _whole("adc_bits", 0, 32, "bits of the converter Q, 0 for none"),
    _number("adc_range_db", "dB", -100.0, 100.0, "full scale of the converter over the receiver's level"),
    Parameter("processing", "processing", "function", "processing S after M and Q, none by default", why_fixed=_CODE),
    _whole("n_bits", 1, 32, "bits of a grey tone"),
    _number("dynamic_range_db", "dB", 0.1, 200.0, "decibels coded into the grey tones"),
    _number("film_gamma", "", 1e-3, 1e3, "slope of the film"),
    _number("film_k", "", 1e-12, 1e12, "constant of the film"),
    _number("i_min_w", "W", 1e-40, 1e12, "calibration of the picture: intensity that becomes 0"),
    _number("i_c_w", "W", 1e-40, 1e12, "calibration of the picture: intensity that becomes level i_qc"),
    _number("i_qc", "", 0.0, 2.0**32, "calibration of the picture: level of the intensity i_c_w"),
    _number("p_rc_w", "W", 1e-40, 1e12, "calibration of the picture: power that becomes grey tone g_rc"),
    _number("g_rc", "", -(2.0**32), 2.0**32, "calibration of the picture: grey tone of the power p_rc_w"),
    _word("season", ("spring_summer", "fall", "winter"), "season of the scattering table"),
    _word("snow", ("none", "dry", "wet"), "snow of a winter"),
    _number("snow_depth_cm", "cm", 0.0, 500.0, "depth of the snow"),
    _number("soil_moisture_low", "m3/m3", 0.01, 0.6, "least volumetric soil moisture that a run may meet"),
    _number("soil_moisture_high", "m3/m3", 0.01, 0.6, "largest volumetric soil moisture that a run may meet"),
    _number("soil_moisture_field_sd", "m3/m3", 0.0, 0.3, "departure of a field's moisture, standard deviation"),
    _number("soil_moisture_region_sd", "m3/m3", 0.0, 0.3, "what neighbouring fields share of it, standard deviation"),
    _number("soil_moisture_region_m", "m", 100.0, 1e5, "distance at which 1/e of that is left in common"),
    _number("wind_low_m_s", "m/s", 0.0, 40.0, "least wind speed over water that a run may meet"),
    _number("wind_high_m_s", "m/s", 0.0, 40.0, "largest wind speed over water that a run may meet"),
    _number("texture_db", "dB", 0.0, 20.0, "departure of parts of a field from its mean, standard deviation"),
    _number("texture_m", "m", 0.1, 1e5, "side of these parts", said="texture size"),
    _number(
        "calibration_sd_db", "dB", 0.0, 10.0, "error of the calibration of a channel on a date, standard deviation",
        said="calibration error",
    ),
    _file("targets_file", "CSV file of cultural targets"),
)  # fmt: skip
"""Parameters of `RadarConfiguration` by their names in ``campaign.toml``."""

RADIOMETER: Final = _table(
    _number(
        "frequency_ghz", "GHz", 0.4, 100.0, "centre frequency; the table of the atmosphere reaches no further",
        name="frequency",
    ),
    Parameter("polarization", "channels", "channels", "polarizations received together", levels=("H", "V")),
    _number("resolution_m", "m", 0.05, 1e6, "side of the footprint at nadir", name="resolution"),
    _number(
        "integration_time_ms", "ms", 1e-4, 1e6, "time over which one footprint's power is averaged",
        name="integration_time",
    ),
    _number("bandwidth_mhz", "MHz", 1e-3, 1e4, "bandwidth before detection", name="bandwidth"),
    _number(
        "noise_temperature_k", "K", 0.0, 1e5, "noise temperature of the receiver with its feed",
        name="noise_temperature",
    ),
    _number("scan_period_s", "s", 1e-3, 1e5, "time of one sweep from left to right and back, or of a turn",
            name="scan_period"),
    _number("altitude_m", "m", 1.0, 2e6, "height of the flight line above the zero of the scene's elevations"),
    _number("speed_m_s", "m/s", 1.0, 1e4, "ground speed"),
    _number("scan_half_angle_deg", "deg", 0.0, 75.0, "reach of the sweep to either side; 0: the scene's edges"),
    _number("conical_incidence_deg", "deg", 0.0, 75.0, "incidence angle of a conical scan; 0 sweeps across the track"),
    _number(
        "heading_deg", "deg", 0.0, 270.0, "direction of flight from north, along the grid of the scene",
        values=(0.0, 90.0, 180.0, 270.0),
    ),
    _word("mode", ("full", "report"), "the whole model, or the first-order simulation of the report of 1979"),
    _word("receiver", ("total_power", "dicke", "correlation"), "kind of the receiver"),
    _number("reference_temperature_k", "K", 0.0, 1000.0, "load of a Dicke or correlation receiver"),
    _number("gain_fluctuation", "", 0.0, 0.1, "relative rms fluctuation of the gain between calibrations"),
    _word("beam", ("gaussian", "box", "sidelobes", "measured"), "antenna pattern along both axes"),
    _file("beam_file", 'CSV file of the "measured" pattern'),
    _number("antenna_limit_m", "m", 0.01, 1e3, "largest antenna that the craft carries"),
    _word("gaps", ("record", "refuse"), "what to do where sweeps leave ground unseen at nadir"),
    _word("overlap", ("average", "nearest"), "what to do where a footprint at nadir holds several sweeps"),
    _word("radiation", ("auto", "rayleigh_jeans", "planck"), "law of thermal radiation"),
    _word(
        "atmosphere", ("us_standard", "midlatitude_summer", "midlatitude_winter", "none"), "profile of the atmosphere"
    ),
    _word("weather", ("clear", "cloud", "rain"), "weather between ground and craft"),
    _number("cloud_kg_m2", "kg/m2", 0.0, 5.0, "liquid water of the cloud"),
    _number("rain_mm_h", "mm/h", 0.0, 150.0, "rate of the rain"),
    _word("temperature", ("exposure", "constant", "layer"), "where the physical temperature of the ground comes from"),
    _number("temperature_low_k", "K", 200.0, 400.0, "temperature of ground without sun"),
    _number("temperature_high_k", "K", 200.0, 400.0, "temperature of bare ground square to the sun"),
    _number("temperature_date_sd_k", "K", 0.0, 50.0, "departure of a date's temperature, standard deviation"),
    _number("temperature_field_sd_k", "K", 0.0, 50.0, "departure of a field's temperature, standard deviation"),
    _number("latitude_deg", "deg", -90.0, 90.0, "latitude of the scene, for the sun"),
    _number("day_of_year", "", 1.0, 366.0, "day of the year, for the sun"),
    _number("hour", "h", 0.0, 24.0, "solar time"),
    _number("exposure_hours", "h", 0.0, 24.0, "how far back exposure to the sun is averaged; 0: that moment"),
    _number("soil_moisture_low", "m3/m3", 0.02, 0.5, "least mean soil moisture that a run may meet"),
    _number("soil_moisture_high", "m3/m3", 0.02, 0.5, "largest mean soil moisture that a run may meet"),
    _number("soil_moisture_field_sd", "m3/m3", 0.0, 0.3, "departure of a field's moisture, standard deviation"),
    _number("soil_moisture_region_sd", "m3/m3", 0.0, 0.3, "what neighbouring fields share of it, standard deviation"),
    _number("soil_moisture_region_m", "m", 100.0, 1e5, "distance at which 1/e of that is left in common"),
)  # fmt: skip
"""Parameters of `RadiometerConfiguration` by their names in ``campaign.toml``."""


CALENDAR: Final = _table(
    _whole("dates", 1, 60, "how many times the ground is looked at"),
    _number("first_day", "d", 1.0, 365.0, "day of the year of the first time; without it the season stands for the day",
            said="first day"),
    _number("interval_days", "d", 0.25, 180.0, "from one time to the next", said="interval"),
    Parameter("days", "days", "days", "days of the year themselves, in place of the three above"),
)  # fmt: skip
"""Parameters of `seqrsm.sensor.sets.Dates`, which every sensor has, by their names in ``campaign.toml``."""


def find(table: Mapping[str, Parameter], name: str) -> Parameter | None:
    """The row of a parameter by its name in ``campaign.toml`` or that of its field; None where there is none."""
    return table.get(name) or next((row for row in table.values() if row.field == name), None)


def value_problems(table: Mapping[str, Parameter], configuration: Any) -> list[Problem]:
    """Every value of a configuration that is impossible alone; None is possible where it is the default."""
    values = {field.name: (getattr(configuration, field.name), field.default) for field in fields(configuration)}
    checked = [(row, values[row.field]) for row in table.values() if row.kind not in ("file", "pattern")]
    found = (row.problem(value) for row, (value, default) in checked if value is not None or default is not None)
    return [problem for problem in found if problem is not None]


def listed(table: Mapping[str, Parameter], configuration: Any) -> list[dict[str, Any]]:
    """Every row in plain values, with the default of its field and whether the field must be given."""
    default = {field.name: field.default for field in fields(configuration)}
    return [
        {
            **{name: getattr(row, name) for name in ("name", "field", "unit", "kind", "what", "allowed", "why_fixed")},
            "low": row.low if row.numeric else None,
            "high": row.high if row.numeric else None,
            "levels": [*row.levels, *row.values],
            "default": None if default[row.field] in (MISSING, ()) else default[row.field],
            "required": default[row.field] is MISSING,
            "factor": not row.why_fixed,
        }
        for row in table.values()
    ]


_Configuration = TypeVar("_Configuration")


def configured(
    sensor: str,
    configuration: Callable[..., _Configuration],
    table: Mapping[str, Parameter],
    settings: Mapping[str, float | str],
    fixed: Mapping[str, float | str] | None,
) -> _Configuration:
    """Configuration of one point of a design.

    Parameters
    ----------
    sensor : str
        "radar" or "radiometer", for messages.
    configuration : type
        Dataclass of the sensor; fields without a default must be given.
    table : Mapping
        `RADAR` or `RADIOMETER`.
    settings, fixed : Mapping
        Levels of the factors, and everything that is no factor; by the names of ``campaign.toml`` or of the fields.

    Raises
    ------
    ConfigurationError
        Unknown, doubled or missing names; impossible values; contradictions; all that can be told at once.
    """
    given: dict[str, object] = {}
    problems: list[Problem] = []
    for name, written in [*settings.items(), *(fixed or {}).items()]:
        row = find(table, name)
        if row is None:
            remedy = f"Known: {', '.join(table)}"
            problems.append(Problem(f"no such {sensor} parameter", remedy, field=name, value=written))
        elif row.field in given:
            problems.append(
                Problem("given twice", "Give it once: as a factor or as fixed, and by one of its names", field=name)
            )
        else:
            given[row.field] = row.converted(written, problems)
    needed = {field.name for field in fields(configuration) if field.default is MISSING}  # type: ignore[arg-type]
    for row in table.values():
        if row.field in needed - given.keys():
            remedy = f"Make it a factor or give it under [simulator.fixed]: {row.what}"
            problems.append(Problem("missing", remedy, field=row.name))
    if problems:
        raise ConfigurationError(*problems)
    return configuration(**given)
