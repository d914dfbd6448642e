rule study:
    # All of a study whose simulations are short in one job of a cluster: the workflow, on the machine of that job.
    output:
        sent=touch("{study}/{goals}.sent"),
    log:
        "{study}/{goals}.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: side_by_side
    resources:
        mem_mb=memory_of_study,
        runtime=minutes("study"),
    params:
        config=CONFIG,
        goals=lambda wildcards: [f"--{goal}" for goal in GOALS if goal in wildcards.goals.split("+")],
        more=options_given,
    shell:
        "export FINGERFIT_STUDY={wildcards.study:q}; exec python -P -m fingerfit run --config {params.config:q}"
        " --cores {threads} {params.goals} -- {params.more:q} > {log} 2>&1"
