rule diagnose_model:
    # Where the model fails and which effect is missing. It solves what its tests and refits need, two at a time.
    input:
        **MESHES,
        rounds=rounds_and_solutions,
        last=last_round,
        settings=ancient(SETTINGS_FILE),
        study=ancient(STUDY_FILES),
        data=f"{MODEL}/prepared.npz",
        estimate=f"{MODEL}/estimate.json",
    output:
        diagnosis=f"{MODEL}/diagnosis.json",
        patterns=f"{MODEL}/diagnosis.npz",
        compare=f"{MODEL}/compare.npz",
        rung=f"{MODEL}/rung.json",
        simulations=f"{MODEL}/simulations.json",
    log:
        f"{MODEL}/logs/diagnose.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 2
    resources:
        mem_mb=2000,
    params:
        settings=PARTS["diagnose"],
        code=CODE["diagnose"],
        made_from=MADE_FROM["diagnose"],
        meshes=MESH_OPTIONS,
        sims=SIMS,
    shell:
        "exec python -P -m fingerfit diagnose {input.settings} --data {input.data} {params.meshes} --sims {params.sims}"
        " --last {input.last} --estimate {input.estimate} --out {output.diagnosis} --threads {threads} 2> {log}"


rule ladder:
    # The models on the way to this one that were diagnosed, as data and as a page to look at.
    input:
        settings=ancient(SETTINGS_FILE),
        rung=f"{MODEL}/rung.json",
    output:
        ladder=f"{STUDY}/ladder.json",
        page=f"{STUDY}/report.html",
    log:
        f"{STUDY}/ladder.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        settings=PARTS["ladder"],
        code=CODE["ladder"],
        made_from=MADE_FROM["ladder"],
    shell:
        "exec python -P -m fingerfit ladder {input.settings} --out {output.ladder} --page {output.page} 2> {log}"
