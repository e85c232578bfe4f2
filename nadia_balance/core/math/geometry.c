/* Geometry of every control tick: convex polygons in the plane, and segments in
 * space.
 *
 * Plain C99 without dependencies and without allocation: the caller gives the
 * room for results.  Only + - * / and sqrt are used, and fma where it is exact,
 * and the compiler must not fuse products with sums (-ffp-contract=off): every
 * processor returns the same bits.
 *
 * Polygons are convex, counter-clockwise, and have their vertices in [m].
 * What functions are for is said in polygon.py and segments.py, which call them.
 */

#include <math.h>

/* Tolerances, far below relevant sizes and far above rounding errors: */
static const double FLAT = 1e-12;       /* half this area [m^2] is a line */
static const double COINCIDENT = 1e-9;  /* closer vertices [m] are one */
static const double PARALLEL = 1e-16;   /* cross product [m^2] of one direction */

typedef struct {
    double x, y;
} Point;

static Point minus(Point a, Point b) {
    return (Point){a.x - b.x, a.y - b.y};
}

static double cross(Point a, Point b) {
    return a.x * b.y - a.y * b.x;
}

static double limited(double value, double low, double high) {
    if (value < low) return low;
    return value > high ? high : value;
}

/* sqrt(x^2 + y^2), rounded correctly but in very rare cases, as Python's
 * math.hypot and math.dist; hypot of libm differs from one processor to the
 * next.  Below 1e-150 it is 0. */
static double length(Point a) {
    double x = fmax(fabs(a.x), fabs(a.y)), y = fmin(fabs(a.x), fabs(a.y));
    double xx = x * x, yy = y * y, root = sqrt(xx + yy), square = root * root;
    if (root == 0.0) return root;
    /* What the three products have lost, exactly. */
    double lost = fma(x, x, -xx) + fma(y, y, -yy) - fma(root, root, -square);
    return root + (xx - square + yy + lost) / (2.0 * root);
}

static double twice_area(const Point *polygon, int n) {
    double sum = 0.0;
    for (int i = 2; i < n; i++)
        sum += cross(minus(polygon[i - 1], polygon[0]),
                     minus(polygon[i], polygon[0]));
    return sum;
}

double area(const Point *polygon, int n) {
    return 0.5 * twice_area(polygon, n);
}

void centroid(const Point *polygon, int n, Point *result) {
    Point origin = polygon[0], sum = {0.0, 0.0}, total = sum;
    double twice = 0.0;
    for (int i = 0; i < n; i++) {
        Point a = minus(polygon[i], origin);
        Point b = minus(polygon[(i + 1) % n], origin);
        double product = cross(a, b);
        twice += product;
        sum.x += (a.x + b.x) * product;
        sum.y += (a.y + b.y) * product;
    }
    for (int i = 0; i < n; i++) {
        total.x += polygon[i].x;
        total.y += polygon[i].y;
    }
    if (twice <= FLAT)
        *result = (Point){total.x / n, total.y / n};
    else
        *result = (Point){origin.x + sum.x / (3 * twice),
                          origin.y + sum.y / (3 * twice)};
}

/* Sorts points by x, then y, each but once; of few ones. */
static int sort(const Point *points, int n, Point *sorted) {
    int count = 0;
    for (int i = 0; i < n; i++) {
        Point p = points[i];
        int j = count;
        while (j > 0 && (p.x < sorted[j - 1].x ||
                         (p.x == sorted[j - 1].x && p.y < sorted[j - 1].y)))
            j--;
        if (j > 0 && p.x == sorted[j - 1].x && p.y == sorted[j - 1].y) continue;
        for (int k = count++; k > j; k--) sorted[k] = sorted[k - 1];
        sorted[j] = p;
    }
    return count;
}

/* The right-hand boundary along the points, which are `step` apart. */
static int half_hull(const Point *points, int n, int step, Point *chain) {
    int count = 0;
    for (int i = 0; i < n; i++, points += step) {
        while (count > 1) {
            Point a = chain[count - 2], b = chain[count - 1];
            Point u = minus(b, a), beyond = minus(*points, b);
            double turn = cross(u, minus(*points, a));
            /* On a line that is vertical up to rounding, b may be beyond. */
            int returns = u.x * beyond.x + u.y * beyond.y < 0.0;
            if (turn > FLAT || (turn > 0.0 && returns)) break;
            count--;
        }
        chain[count++] = *points;
    }
    return count;
}

/* Andrew's monotone chain.  Room for 3 n points.  Returns the number of
 * vertices, or -1 if a point is not finite. */
int hull(const Point *points, int n, Point *vertices) {
    for (int i = 0; i < n; i++)
        if (!isfinite(points[i].x) || !isfinite(points[i].y)) return -1;
    Point *sorted = vertices + 2 * n;
    int count = sort(points, n, sorted);
    if (count < 3) {
        for (int i = 0; i < count; i++) vertices[i] = sorted[i];
        return count;
    }
    int m = half_hull(sorted, count, 1, vertices) - 1;
    m += half_hull(sorted + count - 1, count, -1, vertices + m) - 1;
    if (0.5 * twice_area(vertices, m) > FLAT) return m;
    /* A line up to rounding: its ends. */
    Point ends[2] = {vertices[0], vertices[1]};
    for (int i = 0; i < m; i++)
        for (int j = i + 1; j < m; j++)
            if (length(minus(vertices[i], vertices[j])) >
                length(minus(ends[0], ends[1]))) {
                ends[0] = vertices[i];
                ends[1] = vertices[j];
            }
    vertices[0] = ends[0];
    vertices[1] = ends[1];
    return 2;
}

/* Room for n normals, and then their n offsets. */
void halfspaces(const Point *polygon, int n, Point *normals) {
    double *offsets = &normals[n].x;
    for (int i = 0; i < n; i++) {
        Point a = polygon[i], b = polygon[(i + 1) % n];
        double size = length(minus(b, a));
        normals[i] = (Point){(b.y - a.y) / size, (a.x - b.x) / size};
        offsets[i] = normals[i].x * a.x + normals[i].y * a.y;
    }
}

/* Closest point of the segment from a to b. */
static Point on_segment(Point p, Point a, Point b) {
    Point d = minus(b, a), from = minus(p, a);
    double square = d.x * d.x + d.y * d.y;
    if (square == 0.0) return a;
    double along = limited((from.x * d.x + from.y * d.y) / square, 0.0, 1.0);
    return (Point){a.x + along * d.x, a.y + along * d.y};
}

static Point on_boundary(Point p, const Point *polygon, int n) {
    Point closest = polygon[0];
    double least = INFINITY;
    for (int i = 0; i < n; i++) {
        Point q = on_segment(p, polygon[i], polygon[(i + 1) % n]);
        double distance = length(minus(q, p));
        if (distance < least) {
            least = distance;
            closest = q;
        }
    }
    return closest;
}

int contains(const Point *point, const Point *polygon, int n,
             double tolerance) {
    if (n < 3) {
        Point closest = on_boundary(*point, polygon, n);
        return length(minus(*point, closest)) <= tolerance;
    }
    for (int i = 0; i < n; i++) {
        Point edge = minus(polygon[(i + 1) % n], polygon[i]);
        double turn = cross(edge, minus(*point, polygon[i]));
        if (!(turn >= -tolerance * length(edge))) return 0;
    }
    return 1;
}

void project(const Point *point, const Point *polygon, int n, Point *result) {
    int inside = n > 2 && contains(point, polygon, n, 0.0);
    *result = inside ? *point : on_boundary(*point, polygon, n);
}

static double excess(Point p, Point normal, double offset) {
    return normal.x * p.x + normal.y * p.y - offset;
}

/* The part with n . p <= offset (Sutherland and Hodgman's clipping); -1 if there
 * is no room. */
static int clip(const Point *polygon, int n, Point normal, double offset,
                Point *part, int room) {
    int count = 0;
    Point a = polygon[n - 1];
    double over_a = excess(a, normal, offset);
    for (int i = 0; i < n; i++) {
        if (count + 2 > room) return -1;
        Point b = polygon[i];
        double over_b = excess(b, normal, offset);
        if (over_a * over_b < 0.0) {
            double s = over_a / (over_a - over_b);
            part[count++] = (Point){a.x + s * (b.x - a.x),
                                    a.y + s * (b.y - a.y)};
        }
        if (over_b <= 0.0) part[count++] = b;
        a = b;
        over_a = over_b;
    }
    return count;
}

/* Without nearly coincident vertices: an edge between them has no direction. */
static int without_coincident(const Point *polygon, int n, Point *part) {
    int count = 0;
    Point before = polygon[n - 1];
    for (int i = 0; i < n; i++) {
        Point p = polygon[i];
        if (fabs(p.x - before.x) + fabs(p.y - before.y) > COINCIDENT)
            part[count++] = p;
        before = p;
    }
    return count;
}

/* Room for two times `room` points, of which the part is the beginning: a
 * half-space adds one vertex to a convex polygon. */
int clip_all(const Point *polygon, int n, const Point *normals,
             const double *offsets, int k, Point *part, int room) {
    const Point *source = polygon;
    Point *target = part;
    int count = n;
    for (int j = 0; j < k && count > 0; j++) {
        double least = INFINITY, most = -INFINITY;
        for (int i = 0; i < n; i++) {
            double over = excess(polygon[i], normals[j], offsets[j]);
            if (over < least) least = over;
            if (over > most) most = over;
        }
        if (least >= 0.0) return 0;
        if (most <= 0.0) continue;
        count = clip(source, count, normals[j], offsets[j], target, room);
        source = target;
        target = target == part ? part + room : part;
    }
    if (count <= 0) return count;
    count = without_coincident(source, count, part);
    return 0.5 * twice_area(part, count) > FLAT ? count : 0;
}

/* Room for two times `room` points, and k more and their k numbers. */
int intersection(const Point *first, int n, const Point *second, int k,
                 Point *part, int room) {
    Point *normals = part + 2 * room;
    halfspaces(second, k, normals);
    return clip_all(first, n, normals, &normals[k].x, k, part, room);
}

/* The lowest vertex; of several, the leftmost. */
static int lowest(const Point *polygon, int n) {
    int k = 0;
    for (int i = 1; i < n; i++)
        if (polygon[i].y < polygon[k].y ||
            (polygon[i].y == polygon[k].y && polygon[i].x < polygon[k].x))
            k = i;
    return k;
}

/* Room for n + k points. */
int minkowski_sum(const Point *first, int n, const Point *second, int k,
                  Point *sum) {
    int i0 = lowest(first, n), j0 = lowest(second, k), j = 0, count = 0;
    for (int i = 0; i < n; i++) {
        Point a = first[(i0 + i) % n];
        Point u = minus(first[(i0 + i + 1) % n], a);
        for (int is_before = 1; is_before;) {
            Point b = second[(j0 + j) % k];
            Point v = minus(second[(j0 + j + 1) % k], b);
            double turn = cross(u, v);
            sum[count++] = (Point){a.x + b.x, a.y + b.y};
            is_before = j < k && turn < -PARALLEL;
            if (j < k && turn <= PARALLEL) j++;
        }
    }
    for (; j < k; j++) {
        Point a = first[i0], b = second[(j0 + j) % k];
        sum[count++] = (Point){a.x + b.x, a.y + b.y};
    }
    return count;
}

/* Share of the edge at which p, seen from its begin, is; as numpy divides
 * complex numbers. */
static double share_of(Point edge, Point p) {
    if (fabs(edge.x) >= fabs(edge.y)) {
        double ratio = edge.y / edge.x;
        return (p.x + p.y * ratio) * (1.0 / (edge.x + edge.y * ratio));
    }
    double ratio = edge.x / edge.y;
    return (p.x * ratio + p.y) * (1.0 / (edge.y + edge.x * ratio));
}

/* The vertex that is closest to the boundary of another polygon, its projection
 * there, and the gap. */
static double closest_vertex(const Point *vertices, int n,
                             const Point *polygon, int k, Point *vertex,
                             Point *foot) {
    double least = INFINITY;
    Point gap = {0.0, 0.0};
    for (int i = 0; i < n; i++)
        for (int j = 0; j < k; j++) {
            Point edge = minus(polygon[(j + 1) % k], polygon[j]);
            Point apart = minus(vertices[i], polygon[j]);
            double share = limited(share_of(edge, apart), 0.0, 1.0);
            apart.x -= share * edge.x;
            apart.y -= share * edge.y;
            double square = apart.x * apart.x + apart.y * apart.y;
            if (square < least) {
                least = square;
                gap = apart;
                *vertex = vertices[i];
            }
        }
    *foot = minus(*vertex, gap);
    return length(gap);
}

/* Returns the gap. */
double closest_point(const Point *polygon, int n, const Point *other, int k,
                     Point *result) {
    Point vertex, foot, unused;
    double to_other = closest_vertex(polygon, n, other, k, &vertex, &unused);
    double to_polygon = closest_vertex(other, k, polygon, n, &unused, &foot);
    *result = to_other <= to_polygon ? vertex : foot;
    return fmin(to_other, to_polygon);
}

typedef struct {
    double x, y, z;
} Vector;

typedef struct {
    double R[3][4]; /* [R, p] */
} Pose;

/* An axis of a capsule, in the frame of its body. */
typedef struct {
    Vector begin, axis;
    double square; /* of its length [m^2], at least 1e-12 */
    double radius, body;
} Segment;

typedef struct {
    double first, second; /* numbers of segments */
    double attention;     /* largest distance of their surfaces that counts */
} Pair;

typedef struct {
    double distance;
    Vector normal;   /* from the second to the first */
    Vector point[2]; /* on the axes */
    double body[2];
} Gap;

static Vector combined(Vector a, double s, Vector b) {
    return (Vector){a.x + s * b.x, a.y + s * b.y, a.z + s * b.z};
}

static double dot(Vector a, Vector b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static Vector vector_product(Vector a, Vector b) {
    return (Vector){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z,
                    a.x * b.y - a.y * b.x};
}

static Vector rotated(const Pose *X, Vector v) {
    const double(*R)[4] = X->R;
    return (Vector){R[0][0] * v.x + R[0][1] * v.y + R[0][2] * v.z,
                    R[1][0] * v.x + R[1][1] * v.y + R[1][2] * v.z,
                    R[2][0] * v.x + R[2][1] * v.y + R[2][2] * v.z};
}

static Vector position(const Pose *X) {
    return (Vector){X->R[0][3], X->R[1][3], X->R[2][3]};
}

/* The closest points of two segments (Ericson, Real-time collision detection
 * (2005), Sec. 5.1.9): on line a, then on segment b, then on segment a. */
static void closest_points(const Segment *a, const Segment *b, Vector *p) {
    Vector apart = combined(a->begin, -1.0, b->begin);
    double ab = dot(a->axis, b->axis);
    double ar = dot(apart, a->axis), br = dot(apart, b->axis);
    double squares = a->square * b->square;
    double det = fmax(squares - ab * ab, 1e-12 * a->square * b->square);
    double s = limited((ab * br - b->square * ar) / det, 0.0, 1.0);
    double t = limited((ab * s + br) / b->square, 0.0, 1.0);
    s = limited((ab * t - ar) / a->square, 0.0, 1.0);
    p[0] = combined(a->begin, s, a->axis);
    p[1] = combined(b->begin, t, b->axis);
}

/* The pairs that are near.  Room for num_pairs gaps. */
int near_pairs(const Pose *poses, const Segment *segments, int num_segments,
               const Pair *pairs, int num_pairs, Gap *gaps, Segment *placed) {
    for (int i = 0; i < num_segments; i++) {
        const Pose *X = &poses[(int)segments[i].body];
        placed[i] = segments[i];
        placed[i].begin = combined(rotated(X, segments[i].begin), 1.0, position(X));
        placed[i].axis = rotated(X, segments[i].axis);
    }
    int count = 0;
    for (int i = 0; i < num_pairs; i++) {
        const Segment *a = &placed[(int)pairs[i].first];
        const Segment *b = &placed[(int)pairs[i].second];
        Gap *gap = &gaps[count];
        closest_points(a, b, gap->point);
        Vector apart = combined(gap->point[0], -1.0, gap->point[1]);
        double square = dot(apart, apart), radii = a->radius + b->radius;
        double far = radii + pairs[i].attention;
        if (!(square < far * far)) continue;
        double size = sqrt(square), divisor = fmax(size, 1e-9);
        gap->distance = size - radii;
        gap->normal = (Vector){apart.x / divisor, apart.y / divisor,
                               apart.z / divisor};
        gap->body[0] = a->body;
        gap->body[1] = b->body;
        count++;
    }
    return count;
}

/* Rates of distances, and their derivatives W = [r x n, n] by the velocities
 * [w, v] of the origins of both bodies: n . (v + w x r) = (r x n) . w + n . v;
 * a shift of the point along n, from axis to surface, has no effect. */
void gap_rates(const Gap *gaps, int n, const Pose *poses,
               const Vector (*velocities)[2], double *rates,
               Vector (*derivatives)[2][2]) {
    for (int i = 0; i < n; i++) {
        rates[i] = 0.0;
        for (int side = 0; side < 2; side++) {
            int body = (int)gaps[i].body[side];
            Vector normal = gaps[i].normal, *W = derivatives[i][side];
            Vector r = combined(gaps[i].point[side], -1.0, position(&poses[body]));
            if (side == 1) normal = (Vector){-normal.x, -normal.y, -normal.z};
            W[0] = vector_product(r, normal);
            W[1] = normal;
            rates[i] += dot(W[0], velocities[body][0]);
            rates[i] += dot(W[1], velocities[body][1]);
        }
    }
}
