"""The arithmetic of the recursion: updates of P = U D U' and of theta's covariance, Jury's test.

It is plain Python, which numba compiles without fastmath, so that both give the same bits. The
page at the top of ``armax.py`` shows the place of each function in an update.
"""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
from yawid.estimation.kernel.marks import hot


@hot
def clear(part):
    """Set ``part`` (n,) to zero: a loop compiles in a fraction of the time that a slice takes."""
    for i in range(len(part)):
        part[i] = 0.0


@hot
def push(register, start, length, x):
    """Shift x into ``length`` places of the register from ``start`` on, the newest value first.

    Swapping is faster than a call of memmove.
    """
    for i in range(start, start + length):
        x, register[i] = register[i], x


@hot
def bierman(d, upper, psi, lam, gain, most):
    """Update P = U D U' by the regressor psi (n,); return 1 / alpha, alpha = lambda + psi' P psi.

    P becomes (P - P psi psi' P / alpha) / lambda, by Bierman's (1977) method, and ``gain`` (n,)
    becomes P psi, the Kalman gain times alpha. No entry of D grows beyond ``most``.
    """
    over = 1.0 / lam
    alpha, inverse, column = lam, over, 0
    for j in range(len(psi)):
        f = psi[j]
        for i in range(j):
            f += upper[column + i] * psi[i]
        v = d[j] * f
        mu = -f * inverse
        grown = d[j] * over * alpha
        alpha += f * v
        inverse = 1.0 / alpha
        d[j] = min(grown * inverse, most)
        gain[j] = v
        for i in range(j):
            old = upper[column + i]
            upper[column + i] = old + gain[i] * mu
            gain[i] += old * v
        column += j
    return inverse


@hot
def floor(d, upper, k, weight, gain):
    """Add a pseudo-measurement of theta[k] equal to its estimate, with ``weight`` = 1 / variance.

    It reduces P, by Bierman's method again, and leaves theta unchanged. ``gain`` is overwritten.
    """
    alpha, inverse, column = 1.0, 1.0, k * (k - 1) // 2
    for i in range(k):
        gain[i] = 0.0
    for j in range(k, len(d)):
        f = 1.0 if j == k else upper[column + k]
        v = weight * d[j] * f
        mu = -f * inverse
        before = alpha
        alpha += f * v
        inverse = 1.0 / alpha
        d[j] *= before * inverse
        gain[j] = v
        for i in range(j):
            old = upper[column + i]
            upper[column + i] = old + gain[i] * mu
            gain[i] += old * v
        column += j


@hot
def stable(a):
    """Return whether all zeros of z^n + a1 z^(n-1) + ... lie inside the unit circle.

    ``a`` (n,) is overwritten. Jury's test, as a step-down of reflection coefficients.
    """
    if len(a) == 2:
        return abs(a[1]) < 1.0 and abs(a[0]) < 1.0 + a[1]
    for m in range(len(a) - 1, -1, -1):
        k = a[m]
        if not abs(k) < 1.0:
            return False
        rest = 1.0 / (1.0 - k * k)
        for i in range((m + 1) // 2):
            low, high = a[i], a[m - 1 - i]
            a[i] = (low - k * high) * rest
            a[m - 1 - i] = (high - k * low) * rest
    return True


@hot
def follow_covariance(covariance, echo, psi, gain, h, inverse, e, memory):
    """Update the covariance of theta by one innovation e, which may be white or coloured.

    With K = inverse * gain and F = I - K psi' the error of theta is multiplied by F and driven by
    K e, so that, with h = memory * echo,

        cov  <- F cov F' + K e e K' + F h e K' + K e h' F'
        echo <- F h + K e

    ``echo`` (n,) is what earlier innovations left in theta, weighted by memory^lag: this sums the
    autocorrelation of the innovations recursively (after Grauer and Morelli 2016, with a geometric
    window of lags). lambda(k) enters as it was at each update. A step that was halved to keep C(q)
    stable enters as if it were whole; the information floor changes P but not theta, and so does
    not enter. ``covariance`` (n n,), ``psi``, ``gain`` and ``h`` (n,); ``gain`` becomes K and ``h``
    is overwritten.
    """
    n = len(psi)
    quadratic, cross, dot = e * e, 0.0, 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += covariance[j * n + i] * psi[j]
        quadratic += psi[i] * row
        gain[i] *= inverse
        dot += psi[i] * echo[i]
        h[i] = memory * e * echo[i] - row
    cross = memory * e * dot
    for i in range(n):
        h[i] += gain[i] * (0.5 * quadratic - cross)
        echo[i] = memory * (echo[i] - gain[i] * dot) + gain[i] * e
    for i in range(n):
        for j in range(n):
            covariance[i * n + j] += gain[i] * h[j] + h[i] * gain[j]


@hot
def correlate(residuals, products, eps, lam):
    """Update the running sums of eps(k) eps(k - l), l = 0 to lags: ``products`` (lags + 1,)."""
    products[0] = lam * products[0] + eps * eps
    for i in range(len(residuals)):
        products[i + 1] = lam * products[i + 1] + eps * residuals[i]
    push(residuals, 0, len(residuals), eps)


@hot
def entry_of_p(d, upper, i, j):
    """Return P[i, j] of P = U D U' for i <= j."""
    total = d[j] if i == j else upper[j * (j - 1) // 2 + i] * d[j]
    for k in range(j + 1, len(d)):
        column = k * (k - 1) // 2
        total += upper[column + i] * d[k] * upper[column + j]
    return total
