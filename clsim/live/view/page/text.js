// Numbers as people read them.

export function short(value) {
  for (const [limit, unit] of [[1e9, " G"], [1e6, " M"], [1e3, " k"]]) {
    if (value >= limit) return (value / limit).toPrecision(3) + unit;
  }
  return value >= 100 || Number.isInteger(value) ? value.toFixed(0) : value.toPrecision(2);
}

export const perSecond = (rate) => `${short(rate)} events/s`;

// A share that is not nothing is never shown as nothing.
export const percent = (share) => share > 0 && share < 0.001 ? "< 0.1 %" : `${(100 * share).toPrecision(share < 0.1 ? 2 : 3)} %`;

export const seconds = (us) => `${(us / 1e6).toFixed(3)} s`;

export const span = (us) => us >= 1e6 ? `${(us / 1e6).toPrecision(3)} s` : us >= 1e3 ? `${(us / 1e3).toPrecision(3)} ms` : `${us.toFixed(0)} µs`;
