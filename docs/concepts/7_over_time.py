"""
Over time
=========

Leakage accumulates over repeated decisions: the randomness of independent draws from a fixed mechanism K(u | π) averages out.
Let p_t be the observer's law of the belief, given all earlier decisions. At every step the *sequential rule* solves the
one-step problem with p_t as the prior, at two fixed prices s and λ,

.. code-block:: text

   K_t = argmax_K  E[L(p_u)] − s E[ρ(π,u)] − λ I(π;u)   under p_t,    p_{t+1} = predict(Bayes(p_t, u_t))

with the observer's loss L (here the mean square error of its best estimate), the posterior p_u after the decision u, the regret
ρ and the mutual information I. The rule takes the best of several prices λ of information; the price s of regret is such that
the long-run mean regret equals the budget.
"""

import numpy as np

from inscrutable import MarkowitzProblem, compare, uniform_prior
from inscrutable.experiments.comparison import ComparisonSettings, makers_of
from inscrutable.mechanisms.chains import resting_chain
from inscrutable.reports.style import drawing, looks_of

means = [[0.02, 0.01, 0.005], [-0.03, 0.00, 0.004]]
covariances = [np.diag([0.002, 0.001, 0.0002]), np.diag([0.010, 0.003, 0.0003])]
problem = MarkowitzProblem(means, covariances, risk_aversion=5.0)
chain = resting_chain(uniform_prior(2, 12), 0.9)

settings = ComparisonSettings(budgets=(0.5,), repeats=(1, 2, 5, 10, 30), draws=400)
names = ["CDM", "PDM", "Stackelberg", "rate-distortion", "delay", "sequential"]
found = compare(
    problem, chain, settings, makers=makers_of(names), rng=np.random.default_rng(0)
)
print(found.header())

# %%
# Each rule has half the *silence regret* as its expected regret; the silence regret is that of the best constant decision (the
# value of information). In the left panel the belief is the same at all decisions. The observer knows this; the rule knows it
# on the dotted curve alone. In the right panel the belief is drawn anew at each step with probability 0.1, and the observer has
# filtered it for a long time. The dashed line is the error without decisions.

looks = looks_of([*names])
with drawing(7.4, 3.2, ncols=2, width_ratios=[3, 2]) as (figure, (left, right)):
    for row in found.rows:
        look = looks[row.maker]
        left.plot(
            found.repeats,
            row.repeated_errors,
            look.line,
            color=look.colour,
            marker=look.marker,
            label=row.maker,
        )
    told = found.of("sequential")[0]
    left.plot(
        found.repeats,
        told.told_errors,
        ":",
        color=looks["sequential"].colour,
        label="sequential, knows that the belief stays",
    )
    left.set(xscale="log", xlabel="decisions on one belief", ylabel="error")
    left.set_xticks(found.repeats, [str(n) for n in found.repeats])
    left.minorticks_off()
    places = np.arange(len(found.rows))
    right.barh(
        places,
        [row.path_error for row in found.rows],
        color=[looks[row.maker].colour for row in found.rows],
    )
    right.set_yticks(places, [row.maker for row in found.rows])
    right.invert_yaxis()
    right.set_xlabel("error, followed over time")
    right.axvline(told.path_ceiling, color="#000000", linewidth=0.9)
    right.set_title("solid line: no rule exceeds it", loc="left")
    dashed = {"color": "#000000", "linestyle": "--", "linewidth": 0.9}
    left.axhline(found.prior_error, label="without decisions", **dashed)
    right.axvline(found.prior_error, **dashed)
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    figure.savefig("over_time.png")

# %%
# **No further leakage while the belief stays the same** and rule and observer both know it: the dotted curve is level. The
# proof takes a few lines. Write
#
# .. code-block:: text
#
#    ψ_u(p) = L(p) + λ H(p) − s Σ p(π) ρ(π,u).
#
# 1. The value of a mechanism K at p is Σ_u Pr(u) ψ_u(p_u) − λ H(p), with p_u the posterior after u, because
#    I(π;u) = H(p) − Σ_u Pr(u) H(p_u).
# 2. The posteriors p_u average to p. Every family of laws that average to p is the family of posteriors of some mechanism.
# 3. So the optimum is F(p) − λ H(p), with F the concave envelope of max_u ψ_u.
# 4. Under an optimal mechanism F(p_u) = ψ_u(p_u): otherwise splitting p_u further would raise the value.
# 5. At the law p_u, playing u for certain has the value ψ_u(p_u) − λ H(p_u) = F(p_u) − λ H(p_u), which is the optimum.
# 6. A decision that is played for certain reveals nothing. So the law stays p_u, and the same holds at the next step.
#
# The proof needs the same prices, decisions and caps at every step, an exact optimum, and the least information among equal
# optima. So the rule first tests whether it is optimal to play the last decision again for certain.
#
# **This does not hold** for a belief that stays the same while the rule assumes that it moves. The rule then assumes that the
# observer's information ages, and reveals a little more. An observer who knows that the belief stays accumulates this: the
# solid curve of the sequential rule falls.

for row in found.rows:
    once, last = row.repeated_errors[[0, -1]]
    print(
        f"{row.maker:16s}one decision {once:.2f}, {found.repeats[-1]} on one belief {last:.2f}, "
        f"over time {row.path_error:.2f} at {row.path_bits:.2f} bits a step"
    )
print(f"{'no rule':16s}over time more than {told.path_ceiling:.2f}")

# %%
# **The ceiling.** Let V₁(r; w) be the largest expected loss of the observer after one decision on a belief of law w, at an
# expected regret r. It is jointly concave in r and w. So, where decisions are seen exactly and at once, the observer's loss
# averaged over the steps is at most V₁(mean regret; mean law of the belief) under any rule on the candidate decisions, with any
# memory and any randomisation. The line on the right is the square root of this bound. It comes from a dual solution, so that it is valid even
# if the solver was inexact.
#
# **The rule as a table.** Where the observer can reach only finitely many laws, `SequentialDecisionMaker.as_mechanism()`
# returns the rule as a mechanism whose memory is the law: tables replace the solver. Otherwise the status says that it cannot.
#
# **A delay is enough** where beliefs change within the delay. The observer knows the belief of d steps ago and errs by the
# change since then: with a chain of two states that flips with probability p its guess is wrong with probability (1 − (1 −
# 2p)^d)/2. A belief that stays longer than the delay is revealed exactly, as the left panel shows.
#
# The :ref:`page on worth <sphx_glr_made_concepts_7_worth.py>` states what a rival gains, and against whom no rule protects.
