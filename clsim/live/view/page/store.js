// The newest events, in a ring of typed arrays; sorted by time, so that a window is found by bisection.

const CAPACITY = 1 << 20;
const MASK = CAPACITY - 1;
const ON_BIT = 0x8000;

export class Store {
  constructor() {
    this.t = new Float64Array(CAPACITY);
    this.x = new Uint16Array(CAPACITY);
    this.y = new Uint16Array(CAPACITY);
    this.sign = new Int8Array(CAPACITY);
    this.cause = new Uint8Array(CAPACITY);
    this.clear(0);
  }

  get mask() { return MASK; }
  get first() { return Math.max(0, this.end - CAPACITY); }

  clear(nowUs) {
    this.end = 0;
    this.nowUs = nowUs;
    this.lastUs = -Infinity;
  }

  add(baseUs, nowUs, dt, x, y, cause) {
    if (baseUs < this.lastUs) this.clear(nowUs); // time went back: a jump whose notice was lost
    for (let k = 0, i = this.end & MASK; k < dt.length; k++, i = (i + 1) & MASK) {
      this.t[i] = baseUs + dt[k];
      this.x[i] = x[k];
      this.y[i] = y[k] & ~ON_BIT;
      this.sign[i] = y[k] & ON_BIT ? 1 : -1;
      if (cause) this.cause[i] = cause[k];
    }
    this.end += dt.length;
    if (dt.length) this.lastUs = baseUs + dt[dt.length - 1];
    this.nowUs = Math.max(nowUs, this.nowUs);
  }

  // Number of the first event at or after a time; events are numbered from the first ever added.
  at(timeUs) {
    let low = this.first, high = this.end;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if (this.t[middle & MASK] < timeUs) low = middle + 1; else high = middle;
    }
    return low;
  }
}
