// What eight nodes of a light tree may send a point that it sends on, 0 for those before `first` and from `end` on: all at
// once on a CPU, one after the other on a GPU.
#if defined(__CUDA_ARCH__)
typedef float lanes;
const int width = 1;
const auto root = [](float a) { return sqrtf(a); };
const auto at = [](const float* p) { return *p; };
const auto numbers = [](int i) { return (float)i; };
#else
typedef float lanes __attribute__((ext_vector_type(8)));
typedef float unaligned __attribute__((ext_vector_type(8), aligned(4)));
const int width = 8;
const auto root = [](lanes a) { return __builtin_elementwise_sqrt(a); };
const auto at = [](const float* p) { return lanes(*(const unaligned*)p); };
const auto numbers = [](int) { return lanes{0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f}; };
#endif
const auto most = [](lanes a, lanes b) { return a > b ? a : b; };
const auto least = [](lanes a, lanes b) { return a < b ? a : b; };
const lanes zero = lanes(0.0f), one = lanes(1.0f);
// The cosine of an angle that is smaller by another one, but not below 0.
const auto nearer = [&](lanes cosine, lanes by_cosine, lanes by_sine) {
    const lanes near = cosine * by_cosine + root(most(one - cosine * cosine, zero)) * by_sine;
    return cosine < by_cosine ? near : one;
};
const auto& node = nodes.data[group];
wp::vec_t<8, wp::float32> values(0.0f);
for (int i = 0; i < 8; i += width) {
    lanes x = at(node.middle.data[0] + i) - lanes(to.position[0]);
    lanes y = at(node.middle.data[1] + i) - lanes(to.position[1]);
    lanes z = at(node.middle.data[2] + i) - lanes(to.position[2]);
    const lanes radius = at(node.radius_m.c + i), intensity = at(node.intensity.c + i);
    const lanes distance2 = most(x * x + y * y + z * z, lanes(1.0e-30f)), distance = root(distance2);
    x /= distance;
    y /= distance;
    z /= distance;
    const auto along = [&](const wp::vec_t<3, wp::float32>& v) { return x * lanes(v[0]) + y * lanes(v[1]) + z * lanes(v[2]); };
    // Sine and cosine of half the angle under which the node is seen; all around from inside.
    const lanes seen_sine = least(radius / distance, one);
    const lanes seen = seen_sine < one ? root(most(one - seen_sine * seen_sine, zero)) : -one;
    const lanes facing = at(node.facing.c + i);
    lanes leaving = -(x * at(node.axis.data[0] + i) + y * at(node.axis.data[1] + i) + z * at(node.axis.data[2] + i));
    leaving = at(node.both.c + i) != zero ? most(leaving, -leaving) : leaving;
    leaving = nearer(nearer(leaving, facing, at(node.facing_sine.c + i)), seen, seen_sine);
    leaving = facing > -one ? leaving : one;
    lanes arriving = along(to.normal);
    if (transmission) arriving = most(arriving, -arriving);
    // Between what its middle sends and the most that any part may.
    arriving = lanes(0.5f) * (most(arriving, zero) + most(nearer(arriving, seen, seen_sine), zero));
    lanes sent_on = arriving;
    if (glossy) {
        sent_on = arriving * lanes(to.matt);
        // The lobe, as wide as the node's lights make it; angles to the half vector are half as large.
        const lanes alpha2 = least(lanes(to.alpha2) + lanes(0.25f) * seen_sine * seen_sine, one);
        const lanes narrow = lanes(0.5f) * (one + along(to.mirror)) * (alpha2 - one) + one;
        const lanes lobe = lanes(0.25f * to.gloss) * alpha2 / (lanes(3.14159265f) * narrow * narrow);
        if (to.gloss > 0.0f) sent_on += arriving > zero ? lobe : zero;
    }
    // The mean of the squared distance to a flat or long box, which the sphere is about.
    lanes value = intensity * most(leaving, lanes(LEAST)) * sent_on / (distance2 + radius * radius / lanes(3.0f));
    value = leaving > at(node.reach.c + i) ? value : zero;
    value = intensity > zero ? value : zero;
    const lanes number = numbers(i);
    value = number >= lanes((float)first) ? value : zero;
    value = number < lanes((float)end) ? value : zero;
    for (int k = 0; k < width; ++k) values[i + k] = ((const float*)&value)[k];
}
return values;
