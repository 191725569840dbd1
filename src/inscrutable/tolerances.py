"""All tolerances: what each is relative to, and why it has its value."""

from __future__ import annotations

BELIEF_SUM = 1e-9
"""How far the sum of a user's belief may be from one before it is refused; smaller errors are renormalised.
A belief typed with ten digits passes, one rounded to six does not go unnoticed."""

BELIEF_TABLE_SUM = 5e-3
"""How far a row of a belief file may be from one: files are often rounded to a few digits. Renormalised within it;
a hundred states rounded to four digits stay inside, a forgotten state rarely does."""

COARSEST_BELIEF_SUM = 0.05
"""However coarsely beliefs are rounded, a sum farther than this from one is a mistake in the file: ten states rounded to two
digits stay inside, 0.5 and 0.6 do not."""

TRANSITION_SUM = 1e-8
"""How far a transition or emission row may be from one. Rows are results of arithmetic: looser than a belief."""

SUM_ROUNDING = 1e-14
"""A row of probabilities this close to one is kept digit for digit: renormalising it again would only move its last
digit, and what was checked once (or read from a file) must come back unchanged. A few dozen roundings."""

PUBLIC_PART = 1e-8
"""How far public observations may be from that part of the agent's own, relative to their size: two sums of the same numbers in
another order agree to far less, numbers of another row do not."""

SYMMETRY = 1e-8
"""Largest asymmetry of a covariance or Hessian, relative to its largest entry."""

DEFINITE = 1e-14
"""Smallest eigenvalue, after scaling to unit variances, of a covariance that has a density: below it the rounding of a
Cholesky factor is as large as the eigenvalue."""

CURVATURE = 1e-10
"""A Hessian's smallest eigenvalue may be this far below zero, relative to its largest: rounding of a singular matrix."""

FEASIBILITY = 1e-9
"""How far a decision may violate a row of the feasible set, in units of the row's largest coefficient.
Tight enough that a decision solved here always passes, loose enough for weights summed in floating point."""

PUBLISHED_SUM = 5e-3
"""How far published weights may be from summing to one before a file is refused: fifty weights rounded to four digits."""

COARSEST_SUM = 0.1
"""However coarsely weights are rounded, a sum farther than this from one is a mistake in the file."""

MIN_SLACK = 1e-4
"""Smallest slack of a row that is not tight, in the decision's unit: one basis point, a weight a person would trade."""

STATIONARITY = 1e-12
"""Largest KKT residual of a polished forward solution, relative to the gradient's scale: a few hundred roundings."""

PIVOT = 1e-10
"""Share of a Hessian's diagonal entry that must remain in its Cholesky pivot; below it the bulk kernel hands the
programme to the slower method that can cope with singular ones."""

EXPLAINED = 1e-10
"""Largest KKT residual, relative to the gradient's scale, at which a belief explains a decision.
Between the forward solver's 1e-12 and the 1e-9 of regret that a vertex of the set may have."""

LINEAR_PROGRAMME = 1e-10
"""Feasibility asked of HiGHS and DAQP: the tightest both accept."""

RANK = 1e-7
"""Singular values of the stationarity equations above this, relative to the gradient's scale, determine a coordinate of
the belief; below it a residual of `STATIONARITY` would move the belief by more than 1e-5, so the direction stays free."""

ON_FACE = 1e-9
"""A coordinate or multiplier below this, relative to its scale, counts as zero in a belief set."""

UNEVEN = 1e-3
"""A state whose costs are below this share of the largest is badly scaled: it determines a belief only to `ON_FACE` over this,
1e-6."""

MEMBER_DEPTH = 1e-3
"""Depth inside a belief set at which a member is sought first: far enough from its faces to start a search from."""

LEAST_MEMBER_DEPTH = 1e-6
"""How deep it must lie at least to prove that a set has an interior; shallower sets are left to linear programmes."""

SURE_CONFLICT = 1e-8
"""A belief set whose rows conflict by more than this is empty: ten times the distance that counts as touching."""

SAME_ACTION = 1e-11
"""Decisions closer than this in every coordinate are one decision: above solver noise, below any tradable change."""

SIMPLEX_DIAMETER = 1.5
"""More than any two beliefs are apart: corners of the simplex are √2 apart."""

SAME_BELIEF = 1e-9
"""Beliefs closer than this are one belief: distances are square roots, so noise of 1e-18 in squares."""

REACHED_BELIEF = 1e-12
"""Beliefs computed in different ways and closer than this are one: a few thousand roundings of a filter."""

SAME_LAW = 1e-9
"""Shares of a decision under two beliefs that differ by less are one share: no lottery has an atom below `PROBABILITY`."""

SIGNAL_CELL = 1e-6
"""Width, in standard deviations, below which a cell of a sensor's signals is merged with its neighbour: the probability of a
narrower cell, a difference of tails, would be lost to rounding."""

EXACT_BELIEFS = 1e-8
"""Distance of published beliefs from the steps of a filter, or from one another, up to which they are exact: a hundred times
the accuracy to which the beliefs behind a decision are computed."""

LEAST_BUDGET = 1e-7
"""Relative width, in the root of a regret, of the bracket of the least regret that reaches a distance: searches with closer
budgets do not differ."""

LEAST_ON_FACE = 1e-5
"""Share by which the least regret on a face, found by a quadratic programme, may lie above that of a search."""

FINITE_DIFFERENCE = 1e-6
"""How far outside the feasible set a local solver's trial may lie and still be judged: its difference steps are 1e-8."""

SLACK_SAFETY = 1e-5
"""Margin, relative to `min_slack`, by which a polished decision stays above it: the observer must not round it down, and
the local solver violates its constraints by 1e-10."""

BUDGET_SAFETY = 1e-8
"""Share of a budget that the polish leaves unspent, for the same reason; it costs half as much of the privacy."""

RAY_END = 1e-2
"""Relative accuracy of the end of an affordable ray, which is only a start for the polish."""

SLOPE_PROBE = 1e-6
"""Step of the differences that read a cost's slope along a direction: costs are exact to 1e-12, so six digits are right."""

CHORD = 2e-8
"""A gain in expected privacy below this is not worth a lottery, nor one more pass over the candidates."""

CHORD_GAIN = 1e-6
"""A decision joins a lottery's search where it lies this far above the chord, in units of privacy: a round takes as long as a
single decision, and halves the gap where the frontier is smooth. Privacies are stated to 1e-3."""

ROW_IN_REACH = 1e-6
"""A row with a multiplier or spare slack below this at the end of a local search is nearly active: the critical region beyond
it is searched too."""

NO_PRIVACY = 1e-7
"""A gain in privacy below this is not taken: regret is quadratic in the distance from the true belief, so a regret
lost in the rounding of a cost (1e-16) allows about 1e-8."""

POLISH = 1e-9
"""Accuracy asked of the local polish of a decision; its result is re-judged by the set's own distance."""

SAME_SPENDING = 1e-14
"""Spending ratios that differ by less than this share are tied: a sum of products without cancellation rounds to some 1e-15,
and real price gaps of 1e-13 still count."""

PARAMETER = 1e-9
"""Relative width below which a piece of an unknown cost parameter's range is not halved again: residuals of 1e-10 resolve no
more."""

IDENTIFIED = 1e-6
"""Width of a cost parameter's interval below which it is one value, as a share of that value or of the width of its bounds."""

GAP_STEP = 1e-9
"""Relative accuracy of the plausibility gap: upper minus lower bound of its cutting planes; ten times what the linear
programmes resolve, else they return the same corner for ever."""

PLANE_GAME = 1e-12
"""Gain at which a plane, or a state, enters the basis of the smallest maximum of linear functions scaled to one: rounding of a
small inverse, and far below what the gap asks for."""

NEAR_OPTIMAL = 1e-7
"""Excess regret allowed at the corners of a near-optimal set's outer polytope, relative to the decision's cost."""

PROBABILITY = 1e-9
"""Atoms of a mixture below this probability are dropped and the rest renormalised: HiGHS feasibility is 1e-9 here."""

CALIBRATED = 1e-6
"""How far, relative to the target, a calibrated expected regret may stay below it: differences between decision makers at
equal regret are of the order of a per cent."""

WHOLE_STEPS = 1e-9
"""How far the number of steps in a unit may be from a whole number: 1/0.1 and 1/0.0333333333 pass, 1/0.07 does not."""

NON_EXISTENCE_MARGIN = 1e-2
"""Default distance by which the true belief must miss the consistent set: one percentage point of belief,
because an arbitrarily small change satisfies the paper's definition, which has 0."""

INFEASIBILITY_MARGIN = 1e-6
"""Default plausibility gap of an infeasible decision, in the cost's unit: far above solver noise,
small against any monthly return."""

COVARIANCE_FLOOR = 1e-6
"""Smallest eigenvalue of a fitted covariance when every column of the data is scaled to unit variance: keeps a regime
from collapsing on a handful of points, whatever the columns' units."""

CONSTANT_COLUMN = 1e-12
"""A column whose range is below this share of its largest entry does not vary: what is left is rounding."""

BELIEF_MOVES = 2e-2
"""Distance from its mean (root mean square over the decisions), or range of one regime's probability, below which a belief
hardly moves: two percentage points, less than a decision on four assets resolves."""

EM_CHANGE = 1e-8
"""Baum-Welch stops when the log-likelihood per observation changes by less than this."""

CLAIM_ROUNDING = 1e-6
"""Differences of privacies, and of cost increases as shares of |c*|, below this count as none when the paper's claims
are judged: HiGHS's feasibility times the largest regret over the optimal cost, and above the polish's accuracy."""

NO_COST = 1e-9
"""An expected regret below this share of the largest beside it is rounding: an optimal decision's, not the price of hiding."""

KINK = 1e-9
"""A decoy this near to the point it should be far from, or near to, has no direction: the distance has a kink there."""

TINY = 1e-300
"""Keeps a division by a length that may be zero finite."""

DAMPING = 1e-9
"""Curvature added to a Newton step's, relative to its largest: picks a step where the cost is flat, and slows no other."""

LEAST_WEALTH = 1e-6
"""Wealth, as a share of the best asset's in the outcome, below which it counts as none; times the outcome's probability, below
which marginal costs of growth stay as they are: an optimum's may be of the size of that probability, and slopes stay finite."""

LEAST_WEIGHT = 1e-10
"""A possible outcome of growth less likely than this is staked on as if it were this likely: quadratic programmes resolve
shares of 1e-12, and what is staked too much is of the same size as what is lost by it."""

SHOWN_OPTIMAL = 1e-9
"""Largest residual of the optimality conditions, relative to the largest slope, where Newton's method started from the decision
of another belief: it ends at rounding or has failed."""

CONTRACT = 1e-9
"""Largest breach of a promise about costs, relative to their scale, that a contract checker forgives: accuracy asked of a
decision problem's forward solves."""

SAME_EXPECTED_COST = 1e-3
"""Largest difference, relative to the scale of costs, of a decision maker's expected costs between `decide` and `decide_many`.
Searches end within a millionth of the best privacy, which is flat there: decisions may be its root apart."""

SAME_PRIVACY = 1e-6
"""Largest relative difference of a stated privacy between the two: searches end within it."""

NEARLY_CERTAIN = 0.95
"""Probability of one state in the nearly certain beliefs that a decision maker is tried on."""

DIFFERENCE = 1e-6
"""Length of the checker's difference steps, as a share of the way to another decision; a curvature of the costs' own scale
then adds as much to a slope."""

SLOPE = 1e-5
"""Largest error of a gradient against differences, relative to the costs: ten times a `DIFFERENCE` or its rounding."""

KINKED = 1e-6
"""Loss, relative to the cost's scale, that a belief may suffer from a decision and still explain it where costs have kinks
and no gradient decides: ten times what an interior-point solver leaves."""

COST_ACCURACY = 1e-9
"""How far above the optimal cost a problem's own solution may lie, relative to the largest expected size of a cost: the
allowance that a proof makes where the problem does not state its accuracy. It is widened where one solution shows a larger
error of another."""

COST_ROUNDING = 1e-14
"""Rounding of an expected cost as it is computed, relative to its size: a few dozen roundings. It is all that a constant
added to all costs changes in a proof, and a budget, which limits a difference of costs, is met to no less."""

COMMON_COST = 1e3
"""A cost that all decisions share is subtracted where it exceeds their differences by more than this factor: it would take
three digits. Below it costs are used as they are given."""

LEAST_DIFFERENCE = 1e-5
"""Differences of gradients across decisions count as no smaller than this share of the gradients, over `COMMON_COST`: their
rounding, 1e-16, then stays a tenth of `EXPLAINED`. Gradients count as no smaller than this share of the terms they add up."""

EXACT_COST = 1e-13
"""The same for quadratic programmes solved by active sets: stationary to 1e-12, so optimal to its square and rounding."""

CONE_COST = 1e-6
"""Difference of two optimal costs of one cone programme, relative to them: an interior-point method ends at 1e-8."""

SHARED_DECISION = 1e-11
"""A decision whose cost at a belief exceeds the optimal cost by no more than this, relative to the largest state cost, is
optimal there too: above the rounding of costs; between different decisions at beliefs `SHARED_WIDTH` apart far below it."""

TIED = 1e-9
"""Decisions whose costs at a belief differ by no more than this, relative to the largest state cost, may be tied there: ten
times the residual at which a belief explains a decision, so that a bound never misses a tie that an observer sees."""

SHARED_WIDTH = 1e-3
"""Edge of a cell below which its corners are not tested for a shared decision: neighbours nearly always share one."""

FINEST_CELL = 1e-6
"""Cells narrower than this are not cut: what they may hold cannot be admissible, or is a limit that no decision reaches."""

REDUCED_COST = 1e-11
"""Pivots and reduced costs of the tiny programmes that bound cells: any weights give a valid bound, so that only its tightness
depends on this."""

PROOF_FLOOR = 1e-2
"""A proof's gap is relative to the privacy, or to this where the privacy is smaller: distances of 1e-4 need not be resolved
apart at one per cent."""

PROVED = 1e-6
"""A bound this little above the privacy, in units of belief, proves it: what the polish itself leaves."""

RECOMPUTED = 1e-9
"""Largest difference of a saved result's sums from recomputed ones, as a share of the costs: other orders of addition."""

NO_REGRET = 1e-12
"""Regret, as a share of the mean over beliefs and candidates, that counts as none: a difference of two costs rounds to it.
A smaller budget allows the candidates of least regret alone."""

REGRET_MET = 1e-9
"""How far below its budget an expected regret may stay, as a share of it: the accuracy of a root search."""

REGRET_NEAR = 1e-6
"""The same while the law of the decisions still changes: its effect on the value is quadratic."""

NEWTON_STEP = 1e-8
"""Share of a Newton step below which a barrier function is taken to fall no further."""

BARRIER_ROUNDING = 1e-13
"""Relative rise of a barrier function that is rounding."""

RARELY_PLAYED = 1e-10
"""The probability of an atom below this, in a lottery with hundreds of atoms, goes to the row's cheapest atom: all of them
together change a rate by at most 1e-5 bits."""

RATE_GAP = 1e-3
"""Bits by which a rate and its bound may differ: far below what matters to an observer."""

SELDOM = 1e-3
"""Share of 1/M, for M columns, below which a column counts as unused, and with which a new one starts."""

ENVELOPE = 1e-13
"""How far, relative to its value, a column may lie above a row's concave envelope: a few hundred roundings."""

NO_ERROR = 1e-12
"""Mean square error, as a share of the prior's, that counts as none."""

NO_WEIGHT = 1e-10
"""Weight of a belief below which it does not change the estimates: it plays a best reply to them and is counted afterwards."""

LEAST_CENTRED = 5e-2
"""Least share of the complementarity that an interior-point step leaves: keeps it near the central path."""

ERROR_GAP = 1e-2
"""Share of its bound by which a largest mean square error may be missed where there are many beliefs and decisions."""

SMALL_ERROR_GAP = 1e-6
"""The same where there are few."""

SURELY_WRONG_RETURN = 6.0
"""Simple return of one row above which it is named as suspicious, seven times the price: single shares have done it, tables
of portfolios have not. Student's t with three degrees of freedom at 6 % exceeds it once in a million cells."""

SURELY_WRONG_MOVE = 100.0
"""The same in robust standard deviations, for columns that move less; once in a million cells of such tails as well."""

SPLIT_ROOM = 3.0
"""Robust standard deviations by which a price ratio may miss that of a split: the row's own return is in it."""

SPLIT_CHANCE = 2e-4
"""Chance, for a whole table of fat tails, below which a lone jump to a split's ratio is named; for repeats likewise."""

LEAST_REPEATS = 6
"""Equal returns running that are named however seldom values repeat: half a year of months, a week of days and one."""

COMBINED_COLUMNS = 1e-6
"""Share of a column's variance that other columns leave unexplained, below which it is a combination of them: returns rounded
to six decimals leave 1e-8, an index with weights that follow prices 1e-3."""

COMBINATION_PART = 1e-3
"""Coefficient of a column of unit variance from which it is named as part of a combination: rounded returns leave 1e-5."""

LONGEST_HOLIDAYS = 12.0
"""Days without a row that exchanges have been closed for on holidays, with the weekends at both ends."""

KEPT_DECISION = 1e-7
"""A decision is played for certain where no other breaks its condition of optimality, log c ≤ 0 in nats, by more than this.
Solved steps end a tenth below it, so that what was optimal before a decision still counts as optimal after it."""

SOLVED_STEP = 1e-8
"""The same at the end of a step's solve: a value within this many nats, times the price of information, of the optimum."""

SADDLE_ROUNDING = 1e-13
"""Slope of a saddle value, relative to its size, below which only rounding is left of a Newton step's gain."""

LAW_RESIDUAL = 1e-13
"""Largest residual of the conditions on the law of the decisions, whose scale is one: some hundreds of roundings."""

RETURNING_LAW = 1e-12
"""Probability with which an unused decision may return in the next trial: it is then scaled up or goes to 0."""

SAME_MEMORY = 1e-6
"""Laws of the belief closer than this are one memory of a rule: steps are solved to a gap, so that a law recurs only up to some
1e-8, and the mechanisms after two such laws differ by about as much."""

UNHEARD_BELIEF = 1e-10
"""Weight of a belief in the observer's law below which a step is solved without it: its row then follows from the others' law
of the decisions. A decision that it alone plays would be far less accurate, and Newton's steps would stall. The value changes
by less than the weight times some hundred nats, that is less than `KEPT_DECISION`."""

ANSWER_BARRIER = 1e-6
"""Height of the barrier that keeps a rival's mixed answers inside, as a share of the prior loss over all answers together. A
step is then optimal for a slightly different loss, and the mixture after every decision is unique. Against cone programmes it
falls short by up to eight times this; with a tenth of it a constant decision cannot be told from nearly constant ones."""

CURVATURE_STEP = 1e-5
"""Share of the way to a sure state over which a difference of a rival's costs is its curvature: a solution's 1e-12 over it is
1e-7, and steps with a curvature of another piece only take a few more rounds."""

NEW_DECISION = 1e-3
"""Probability with which a decision enters a step before its law is solved."""

SEEN_DECISION = 1e-4
"""Least probability of a decision in the second derivatives of a step: one that is not played may be so after the step, and
without it Newton's steps alternate between decisions that are nearly alike."""

LEAST_FALL = 1e-4
"""Share of the fall along its slope that a step of a line search must attain: the usual one of Armijo's rule."""

SHORTEST_STEP = 1e-6
"""Share of Newton's step below which a line search counts as failed."""

HARDLY_MIXED = 1e-3
"""Share of a rival's answer in a mixture of its answers below which the mixture does as well without it."""

MISSING_ANSWER = 1e-6
"""Share of the prior loss that a rival's answer must save after a decision to be added to those of the step: a tenth of
`STEP_GAP`."""

BARRIER_GAP = 20
"""Multiples of the barrier's height by which the bound of a step's value can lie above it: −log of shares down to 1e-9."""

LEAST_INFORMATION_PRICE = 1e-3
"""Least price of information, as a share of the prior loss per nat, at which a step is solved. It replaces a price of 0: it
costs at most a thousandth of the prior loss for every nat leaked, and ties go to the least information."""

STILL_CONTROL = 1e-4
"""Share of its prior variance below which a control variate is dropped. Where a rule becomes constant, so that the law hardly
moves, its regret would otherwise be estimated a million times too large."""

STEP_GAP = 1e-5
"""Gap of a step's value by its dual bound, as a share of the prior loss, in nats where information alone counts, above which
the step counts as not solved. Steps end at `SOLVED_STEP` times the price; this is a thousand times more."""

SILENT_PRICE = 1e-6
"""Price of regret, in units of loss per mean regret of the cheapest constant decision, at which nothing leaks: any so small
plays that decision for ever."""

SAME_PRICES = 1e-4
"""Logarithm of the ratio of two prices below which simulations with the same draws do not tell their regrets apart."""

SPENDING_MET = 2e-5
"""Share of a budget by which a simulated long-run regret may miss it where half its standard error is smaller still. Where
information alone counts, control variates leave a standard error of 4e-5 of the budget; with 2e-4 here the long-run regret of
the example's rule was 4 standard errors below its budget."""

CEILING_GAP = 2e-5
"""Share of the prior loss to which the best price of a ceiling is found."""

LEAST_TEMPTING = 1e-4
"""Accuracy of the estimates after unused decisions in a bound, as a share of the prior loss; they loosen it by as much."""

LEAST_LAW = 1e-9
"""Share of the prior in the posterior laws of cuts of the information, so that their logarithms are finite."""

LEAST_SPREAD = 1e-3
"""Share of the differences of a rival's answers that is the least unit of its loss."""

NO_DRIFT = 1e-9
"""Size of the moves π − P'π of a path's cycles in a direction that is rounding: the entries of each move sum to zero."""

BALANCED = 1e-9
"""Mean of these moves, at size one, that counts as zero; without weights it is about one over the root of the cycles."""

LINE_SEARCH = 1e-4
"""Share of the way between two tables to which the best mixture of them is found; the programme improves it."""

GUARANTEE_ROUNDING = 1e-13
"""Largest violation of a guarantee by a table that is not repaired: probabilities and errors of beliefs are at most one, and
are sums over some hundreds of beliefs."""

GUARANTEE_MET = 1e-9
"""Largest violation that counts as none where no other table gives more: ten times the accuracy of linear programmes. All other
tables keep within `GUARANTEE_ROUNDING`."""

DEAREST_REPAIR = 1e-3
"""Share of the way to a rule that does not depend on the belief beyond which so small a violation is not repaired."""

LEAST_REGRET_GAP = 1e-4
"""Default gap between a least regret and its bound, as a share of the silence regret."""

STABLE = 1e-12
"""Distance of an eigenvalue's modulus from one below which a stationary law is not computed: rounding decides of it."""

RICCATI = 1e-12
"""Residual of a steady covariance, relative to its largest entry, to which the Riccati equation is solved: its inverse is how
large a covariance may grow beside its noises before it counts as one that does not converge."""

ROUNDED_RICCATI = 1e-8
"""The same where the products of a prediction are so much larger than the covariance that their rounding leaves no less."""

INTERIOR = 1e-11
"""Where an interior-point method for alphas ends, relative to the expected returns: near enough to tell which rows are tight;
on these the decision is then solved to `STATIONARITY`."""

NO_VARIANCE = 1e-13
"""Eigenvalue of a covariance, as a share of the largest, that counts as none: some hundreds of roundings."""

WELL_CONDITIONED = 1e-5
"""Ratio of the smallest to the largest diagonal entry of a triangular factor above which it stands for a large covariance."""

ALL_LEFT = 1e-9
"""A remaining share of a variance above one minus this counts as one: nothing leaks about it, and no noise is drawn."""

COMMUTING = 1e-12
"""Difference of two products of matrices, relative to both, below which the matrices have the same directions."""

TIED_RATE = 1e-12
"""Relative difference of two ratios of gain to cost that counts as a tie, which goes to the least information."""

LOST_ERROR = 1e-7
"""Relative accuracy of the largest error of one decision: a tenth of the cone programmes'."""

SIMULATED_SPENT = 1e-3
"""How far a simulated regret may be from the budget, as a share: a tenth of its standard error at ten thousand draws."""

COARSELY_SPENT = 1e-2
"""How far from its limit a regret in single precision may be, as a share: one more Newton step is then near enough."""

SAME_PRICE = 1e-13
"""Relative width of a bracket of prices of regret that is one price: a few hundred roundings."""

SETTLED = 1e-10
"""Relative change of the covariances and of their values ahead below which a rule over time is its own next iterate."""

SAME_RESIDUALS = 1e-8
"""Relative singular value below which differences of residuals say nothing new: the square root of a rounding."""

REGRET_SPENT = 1e-9
"""How far the regret of a rule over time may miss its limit before a mixture of two rules spends it, as a share of it."""

MIXTURE_LOSS = 1e-8
"""Largest loss of a mixture of two rules over time against the best one, as a share of the limit times the price of regret."""

ERROR_PRICES = (1e-2, 1e-3, 1e-4, 1e-5)
"""Prices of the bits of one direction, as shares of the mean error of a direction, by which the largest error over time is
approached: at the last two all bits together are worth some hundred-thousandths or millionths of it."""

ERROR_OVER_TIME_GAP = 1e-5
"""Gap of a largest error over time by its dual bound, as a share of it, at which no smaller price of bits is tried."""

REGRET_NEARLY_SPENT = 1e-2
"""The same for rules that are only starts at a smaller price of bits."""

OVER_TIME_GAP = 1e-4
"""Gap of a rule over time by its dual bound, as a share of it, that counts as none."""

SAME_RULE = 1e-6
"""Relative difference up to which two computations of a rule on private means are one: other libraries round otherwise, and a
rule over time has converged to a hundredth of it."""

DEGENERATE = 1e-8
"""The residual that is accepted of an interior point, relative to the slopes, where rows are so degenerate that no set of tight
ones is told: its decision then costs about as much too much."""

WAY_END = 1e-6
"""Share of the longest way along which exposures can be moved that is left where bounds of views are searched: at its end the
decisions are one point, and programmes over it are degenerate."""

LEAST_RAY_GAIN = 1e-3
"""Relative gain of a distance between views below which the rays of one start end. Of 70 capped problems of 4 and 12 assets
four gain up to .04 % with a hundredth, in 1.4 times the time; with ten times as much four lose up to .1 %, in .8 times."""

SETS_EXPLAINED = 1e-4
"""Distance of sets of beliefs from the steps of a filter up to which a sensor explains them: the search among sensors ends
before rounding does, and intervals of beliefs are a hundred times as wide where they matter."""

UNCERTAIN_SENSOR = 1e-6
"""How far the probabilities of a family of sensors stay away from 0 and 1: there the agent's own filter would rule states out
for good."""

NOISY_PROBABILITY = 5e-2
"""How far below zero a transition's entries may be that a few noisy steps give, before they are taken for steps of different
symbols."""

SCORE_STEP = 1e-4
"""Half the difference of parameters by which slopes of likelihoods are read, as a share of the parameter's range: likelihoods
are right to 1e-12, so that slopes are to 1e-8; what the curvature takes off is of the same size."""

PARAMETER_SLOPE = 1e-5
"""The same for the slopes that the maximisation of the likelihood uses."""

PARAMETER_PLACE = 1e-6
"""Width, as a share of a parameter's range, at which the search for the largest likelihood ends: intervals are far wider."""

TRANSITION_TOLD = 1e-9
"""How well beliefs must determine a transition: the gap of the equations of a symbol's steps times the least singular value of
the transition. Rounding over it is the error of the transition, here some 1e-7; below it the transition is left open."""
