"""What all tables of a scene's TOML are made of."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, Strict

Number = Annotated[float, Strict()]
Positive = Annotated[float, Strict(), Field(gt=0)]
NonNegative = Annotated[float, Strict(), Field(ge=0)]
Whole = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]
Vector = tuple[Number, Number, Number]
Size2 = tuple[Positive, Positive]
Size3 = tuple[Positive, Positive, Positive]
Quaternion4 = tuple[Number, Number, Number, Number]
Share = Annotated[float, Strict(), Field(ge=0, le=1)]
Reflectance = tuple[Share, Share, Share]
NonNegatives = tuple[NonNegative, NonNegative, NonNegative]
Radiance = tuple[NonNegative, NonNegative, NonNegative]
Pixels = Annotated[int, Strict(), Field(ge=1, le=16384)]


class Table(BaseModel):
    """A TOML table: no unknown keys, no NaN, no infinity."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)
