//! Clusters with a ball around each, which tells from afar how far apart two of them are.
//!
//! A ball is a centre, a spread and a radius. The centre c is some average Σ wᵢ pᵢ of the
//! members, with weights that are not negative and add up to one; the spread is the variance
//! V = Σ wᵢ |pᵢ − c|² under these weights. For clusters A and C the average over members of
//! both is
//!
//! > Σ wᵢ vⱼ |aᵢ − cⱼ|² = |c_A − c_C|² + V_A + V_C
//!
//! and no average exceeds the largest: their distance, that of the farthest pair, is at least
//! the root of this. Any weights give a true bound. Those that make it sharp put the centre
//! where the smallest ball around the members has it: the variance is then at its largest, the
//! squared radius of that ball. A few steps of Frank and Wolfe's method towards that maximum
//! get near enough (Bădoiu and Clarkson 2003).

use crate::Error;
use crate::parallel::Crew;
use crate::points::{Points, squared_distance};

/// Steps towards the smallest ball that a new cluster's ball takes.
const STEPS: u16 = 8;

/// A ball whose squared radius exceeds its spread by no more than this is small enough.
const NEAR_ENOUGH: f64 = 1.03;

/// A centre that has been moved this often is computed anew.
const MOST_STEPS: u16 = 1000;

/// How far a centre may be from the average that it stands for, in parts of its size.
///
/// Each of its moves, at most [`MOST_STEPS`] and a few, rounds by two units of 2^-53 at most.
const DRIFT: f64 = 1.0 / (1_u64 << 41) as f64;

/// Clusters to be handled together: how many one job takes.
const PER_JOB: usize = 256;

/// The clusters that there are at some time.
pub(crate) struct Clusters {
    dim: usize,
    /// The smallest index, as given, of each cluster's points.
    pub reps: Vec<u32>,
    starts: Vec<u32>,
    members: Vec<u32>,
    centres: Vec<f64>,
    /// Variance of the members under some weights, about the centre.
    pub spreads: Vec<f64>,
    /// Squared distance of the farthest member from the centre.
    pub radii: Vec<f64>,
    steps: Vec<u16>,
}

impl Clusters {
    /// Every point a cluster of its own.
    pub fn singles(points: &Points) -> Self {
        let n = points.len();
        Self {
            dim: points.dim,
            reps: points.given_at.clone(),
            starts: (0..=n as u32).collect(),
            members: (0..n as u32).collect(),
            centres: points.rows.clone(),
            spreads: vec![0.0; n],
            radii: vec![0.0; n],
            steps: vec![0; n],
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.reps.len()
    }

    /// The rows of a cluster's points.
    pub fn members(&self, cluster: usize) -> &[u32] {
        &self.members[self.starts[cluster] as usize..self.starts[cluster + 1] as usize]
    }

    /// The centre of a cluster's ball.
    pub fn centre(&self, cluster: usize) -> &[f64] {
        &self.centres[cluster * self.dim..][..self.dim]
    }

    /// What rounding may have added to the distance from a cluster that its ball vouches for.
    ///
    /// A centre that is off by δ changes its distance by δ and the spread, a sum over members
    /// no farther than D from it, by 2 δ D: together less than 4 δ in D.
    pub fn drift(&self, cluster: usize) -> f64 {
        let size = |centre: &[f64]| centre.iter().map(|x| x * x).sum::<f64>().sqrt();
        4.0 * DRIFT * (size(self.centre(cluster)) + self.radii[cluster].sqrt())
    }

    /// All centres, row-major.
    pub fn centres(&self) -> &[f64] {
        &self.centres
    }

    /// The same clusters, the `i`-th being what was the `order[i]`-th.
    pub fn rearranged(&self, order: &[u32]) -> Self {
        let mut starts = Vec::with_capacity(order.len() + 1);
        let mut members = Vec::with_capacity(self.members.len());
        let mut centres = Vec::with_capacity(self.centres.len());
        starts.push(0);
        for &cluster in order {
            members.extend_from_slice(self.members(cluster as usize));
            starts.push(members.len() as u32);
            centres.extend_from_slice(self.centre(cluster as usize));
        }
        Self {
            dim: self.dim,
            reps: pick(&self.reps, order),
            starts,
            members,
            centres,
            spreads: pick(&self.spreads, order),
            radii: pick(&self.radii, order),
            steps: pick(&self.steps, order),
        }
    }

    /// What becomes of the clusters when each is united with all of the same root.
    ///
    /// `roots[i]` is the cluster that `i` has gone into, itself if it has swallowed others or
    /// none. Takes O(n) time for `n` points.
    pub fn united(&self, crew: &Crew<'_>, points: &Points, roots: &[u32]) -> Result<Self, Error> {
        let (dim, m) = (self.dim, self.len());
        let mut number = vec![u32::MAX; m];
        let mut count = 0;
        for cluster in (0..m).filter(|&cluster| roots[cluster] as usize == cluster) {
            number[cluster] = count;
            count += 1;
        }
        let union = |cluster: usize| number[roots[cluster] as usize] as usize;
        let mut starts = vec![0; count as usize + 1];
        for cluster in 0..m {
            starts[union(cluster) + 1] += self.members(cluster).len() as u32;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }

        let mut places = starts.clone();
        let mut unions = Self {
            dim,
            reps: vec![u32::MAX; count as usize],
            starts,
            members: vec![0; self.members.len()],
            centres: vec![0.0; count as usize * dim],
            spreads: vec![0.0; count as usize],
            radii: vec![f64::NAN; count as usize],
            steps: vec![0; count as usize],
        };
        for cluster in 0..m {
            let (union, members) = (union(cluster), self.members(cluster));
            let place = places[union] as usize;
            unions.members[place..place + members.len()].copy_from_slice(members);
            let is_first = place == unions.starts[union] as usize;
            places[union] += members.len() as u32;
            unions.reps[union] = unions.reps[union].min(self.reps[cluster]);
            if is_first {
                unions.centres[union * dim..][..dim].copy_from_slice(self.centre(cluster));
                unions.spreads[union] = self.spreads[cluster];
                unions.radii[union] = self.radii[cluster];
                unions.steps[union] = self.steps[cluster];
            } else {
                unions.take_in(union, self, cluster);
            }
        }
        unions.refine(crew, points)?;
        Ok(unions)
    }

    /// Average a union's centre with that of one more part, for the largest variance.
    fn take_in(&mut self, union: usize, parts: &Self, part: usize) {
        let centre = &mut self.centres[union * self.dim..][..self.dim];
        let apart = squared_distance(centre, parts.centre(part));
        let (here, there) = (self.spreads[union], parts.spreads[part]);
        if apart > 0.0 {
            let weight = ((apart + there - here) / (2.0 * apart)).clamp(0.0, 1.0);
            move_towards(centre, parts.centre(part), weight);
            let rest = 1.0 - weight;
            self.spreads[union] = rest * here + weight * there + rest * weight * apart;
        }
        let steps = self.steps[union].max(parts.steps[part]);
        self.steps[union] = steps.saturating_add(1);
        self.radii[union] = f64::NAN;
    }

    /// Shrink the balls of new clusters, those without a radius.
    fn refine(&mut self, crew: &Crew<'_>, points: &Points) -> Result<(), Error> {
        let (dim, starts, members) = (self.dim, &self.starts, &self.members);
        let balls = self
            .centres
            .chunks_mut(dim * PER_JOB)
            .zip(self.spreads.chunks_mut(PER_JOB))
            .zip(
                self.radii
                    .chunks_mut(PER_JOB)
                    .zip(self.steps.chunks_mut(PER_JOB)),
            )
            .enumerate();
        let refine = |job: usize, balls: &mut dyn Iterator<Item = Ball<'_>>| {
            for (i, ball) in balls.enumerate().filter(|(_, ball)| ball.radius.is_nan()) {
                let cluster = job * PER_JOB + i;
                let range = starts[cluster] as usize..starts[cluster + 1] as usize;
                ball.refine(points, &members[range]);
            }
        };
        crew.each(
            balls,
            || (),
            |(), (job, ((centres, spreads), (radii, steps)))| {
                let states = spreads.iter_mut().zip(radii).zip(steps);
                let mut balls = centres.chunks_mut(dim).zip(states).map(
                    |(centre, ((spread, radius), steps))| Ball { centre, spread, radius, steps },
                );
                refine(job, &mut balls);
            },
        )?;
        Ok(())
    }
}

/// One cluster's ball, to be changed.
struct Ball<'a> {
    centre: &'a mut [f64],
    spread: &'a mut f64,
    radius: &'a mut f64,
    steps: &'a mut u16,
}

impl Ball<'_> {
    fn refine(self, points: &Points, members: &[u32]) {
        let Self { centre, spread, radius, steps } = self;
        if *steps > MOST_STEPS {
            // Start again from a point, which is its own average without any rounding.
            centre.copy_from_slice(points.row(members[0]));
            (*spread, *steps) = (0.0, 0);
        }
        for step in 0..=STEPS {
            let mut farthest = (members[0], -1.0);
            for &member in members {
                let apart = squared_distance(points.row(member), centre);
                if apart > farthest.1 {
                    farthest = (member, apart);
                }
            }
            let (member, apart) = farthest;
            *radius = apart;
            if step == STEPS || apart <= *spread * NEAR_ENOUGH {
                return;
            }
            // The variance, a parabola in the weight, is largest here.
            let weight = ((apart - *spread) / (2.0 * apart)).clamp(0.0, 1.0);
            move_towards(centre, points.row(member), weight);
            *spread = (1.0 - weight) * (*spread + weight * apart);
            *steps += 1;
        }
    }
}

fn move_towards(centre: &mut [f64], target: &[f64], weight: f64) {
    for (x, &y) in centre.iter_mut().zip(target) {
        *x += weight * (y - *x);
    }
}

fn pick<T: Copy>(values: &[T], order: &[u32]) -> Vec<T> {
    order.iter().map(|&i| values[i as usize]).collect()
}
