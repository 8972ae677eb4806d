"""What a scene's TOML may say of light that changes, and of the light of the day."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, Strict

from clsim.scene.light.spectral import are_weights
from clsim.scene.toml.schema_base import Flag, NonNegative, NonNegatives, Number, Positive, Share, Table


def _in_greenwich(time: datetime) -> datetime:
    """Return the same time in Greenwich, without an offset."""
    try:
        return time if time.tzinfo is None else time.astimezone(timezone.utc).replace(tzinfo=None)
    except OverflowError:
        raise ValueError("expected a time in the years 1 to 9999 of Greenwich") from None


def _seen(spectral: Any) -> Any:
    """Refuse what are no weights, in one sentence."""
    numbers = isinstance(spectral, list | tuple) and [type(each) in (int, float) for each in spectral] == [True] * 3
    if (numbers or isinstance(spectral, str)) and are_weights(spectral):
        return spectral
    raise ValueError("expected luminance, silicon, or weights of R, G and B from 0, and not all 0")


Spectral = Annotated[Literal["luminance", "silicon"] | tuple[float, float, float], BeforeValidator(_seen)]


class SineTable(Table):
    """A sine about the light's own radiance, as of lamps on the mains: 100 or 120 Hz."""

    kind: Literal["sine"]
    frequency_hz: Positive = Field(description="of the light, twice that of the mains")
    depth: Share = Field(1.0, description="(largest − smallest) / (largest + smallest)")
    phase_deg: Number = 0.0


class PwmTable(Table):
    """A lamp that is switched on and off, as dimmed LEDs and markers are."""

    kind: Literal["pwm"]
    frequency_hz: Positive
    duty: Share = Field(0.5, description="share of each period, from its start on, in which it is on")
    low: Share = Field(0.0, description="what is left while it is off")
    phase_deg: Number = 0.0


class FactorTable(Table):
    """How bright a light is at a time, as a multiple of its own radiance."""

    time_s: NonNegative
    factor: NonNegative | NonNegatives = Field(description="a number, or one each for red, green and blue")


class LightKeyframesTable(Table):
    """Factors at times."""

    kind: Literal["keyframes"]
    keyframes: Annotated[tuple[FactorTable, ...], Field(min_length=1)]
    interpolation: Literal["linear", "step"] = Field("linear", description="step holds each factor until the next")
    repeat: Flag = Field(False, description="begin anew at the time of the last")


MODULATIONS = ("sine", "pwm", "keyframes")
AnyModulation = Annotated[SineTable | PwmTable | LightKeyframesTable, Field(discriminator="kind")]
Modulation = Annotated[AnyModulation | None, Field(description="how its light changes with time")]


class DaylightTable(Table):
    """A clear sky and the sun: where the sun stands by angles, or by place and time."""

    elevation_deg: Annotated[float, Strict(), Field(ge=-90, le=90)] | None = Field(
        None, description="of the sun over the horizon"
    )
    azimuth_deg: Number = Field(180.0, description="of the sun, from north, which is −z, by east, which is +x")
    latitude_deg: Annotated[float, Strict(), Field(ge=-90, le=90)] | None = Field(None, description="north is positive")
    longitude_deg: Annotated[float, Strict(), Field(ge=-180, le=180)] = Field(0.0, description="east is positive")
    time: Annotated[datetime, Strict(), AfterValidator(_in_greenwich)] | None = Field(
        None, description="a date and time such as 2024-06-21T14:00:00+02:00; Greenwich's without an offset"
    )
    turbidity: Annotated[float, Strict(), Field(ge=1, le=10)] = Field(
        3.0, description="2 is very clear air, 6 moist, 10 hazy"
    )
    ground: Share = Field(0.3, description="reflectance of the ground, which lights the sky")
    sky_scale: NonNegative = Field(1.0, description="times the sky's own radiance per nanometre")
    sun_scale: NonNegative = Field(1.0, description="likewise of the sun")
