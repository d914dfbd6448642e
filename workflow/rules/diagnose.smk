rule diagnose_model:
    # Where the model fails and which effect is missing. It solves what its tests and refits need, two at a time.
    input:
        meshes=meshes,
        below=below("simulations.json"),
        residual_below=below("residual.npz"),
        rounds=rounds_and_solutions,
        last=last_round,
        settings="{study}/{model}/settings.json",
        study=study_files,
        data=data,
        estimate="{study}/{model}/estimate.json",
    output:
        diagnosis="{study}/{model}/diagnosis.json",
        patterns="{study}/{model}/diagnosis.npz",
        compare="{study}/{model}/compare.npz",
        rung="{study}/{model}/rung.json",
        simulations="{study}/{model}/simulations.json",
        residual="{study}/{model}/residual.npz",
    log:
        "{study}/{model}/logs/diagnose.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 2
    resources:
        mem_mb=memory(2, diagnosed=True),
        runtime=minutes("diagnose_model"),
        time_limit=time_limit,
    params:
        settings=part("diagnose", "settings"),
        code=part("diagnose", "code"),
        made_from=part("diagnose", "made_from"),
        meshes=mesh_options,
        sims=sims,
    shell:
        "exec python -P -m fingerfit diagnose {input.settings} --data {input.data} {params.meshes} --sims {params.sims}"
        " --last {input.last} --estimate {input.estimate} --out {output.diagnosis} --threads {threads}"
        " --time-limit {resources.time_limit} 2> {log}"


rule ladder:
    # The models of a study on the way to its last one that were diagnosed, as data and as a page to look at.
    input:
        settings=settings_of_top,
        rungs=rungs,
    output:
        ladder="{study}/ladder.json",
        page=report(
            "{study}/report.html",
            caption="../report/page.rst",
            category="{study}",
            subcategory="all models",
            labels={"result": "diagnosis"},
        ),
    log:
        "{study}/ladder.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=memory(),
        runtime=minutes("ladder"),
    params:
        settings=part_of_top("ladder", "settings"),
        code=part_of_top("ladder", "code"),
        made_from=part_of_top("ladder", "made_from"),
    shell:
        "exec python -P -m fingerfit ladder {input.settings} --out {output.ladder} --page {output.page} 2> {log}"
