// Whether a number is neither NaN nor infinite, by its bits.
union { float value; unsigned int bits; } both;
both.value = x;
return (both.bits & 0x7f800000u) != 0x7f800000u;
