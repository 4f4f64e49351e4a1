"""Which actions an answer describes, and how it is written: in the world's frame."""

MIN_PROBABILITY = 0.05


def chosen(query, probabilities):
    """The actions of one target that a query selects, the most probable first.

    probabilities: a NumPy array [K]"""
    order = (-probabilities).argsort(kind="stable")
    selection = query.WhichOneof("selection")
    if selection == "top_k":
        return order[: query.top_k].tolist()
    if selection == "action_ids":
        wanted = set(query.action_ids.ids)
        return [action for action in order.tolist() if action in wanted]
    least = query.min_probability if selection else MIN_PROBABILITY
    return order[probabilities[order] >= least].tolist()


def write(answer, query, action, probability, latent, sigma, mean, covariance):
    """Appends one action's distribution to a TargetPrediction. All arrays are NumPy's.

    latent: mean and stddev [D]; sigma: [2D+1, 2, T], the decoded mean first; mean: [2, T];
    covariance: [3, T] xx, xy, yy"""
    out = answer.distributions.add(action_id=action, probability=probability)
    out.latent_mean.extend(latent[0].tolist())
    out.latent_stddev.extend(latent[1].tolist())
    sigma = sigma.tolist()
    out.mean_trajectory.x.extend(sigma[0][0])
    out.mean_trajectory.y.extend(sigma[0][1])
    if not query.omit_sigma_trajectories:
        for x, y in sigma:
            trajectory = out.sigma_trajectories.add()
            trajectory.x.extend(x)
            trajectory.y.extend(y)
    out.moments.mean_x.extend(mean[0].tolist())
    out.moments.mean_y.extend(mean[1].tolist())
    out.moments.covariance_xx.extend(covariance[0].tolist())
    out.moments.covariance_xy.extend(covariance[1].tolist())
    out.moments.covariance_yy.extend(covariance[2].tolist())
