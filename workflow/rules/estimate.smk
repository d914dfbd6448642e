rule estimate:
    # The constants with their standard errors, from the last round and the sensitivities it asked for.
    input:
        **MESHES,
        rounds=rounds_and_solutions,
        last=last_round,
        settings=ancient(SETTINGS_FILE),
        data=f"{MODEL}/prepared.npz",
    output:
        estimate=f"{MODEL}/estimate.json",
        table=f"{MODEL}/table.txt",
    log:
        f"{MODEL}/logs/estimate.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 2
    resources:
        mem_mb=1000,
    params:
        settings=PARTS["estimate"],
        code=CODE["estimate"],
        made_from=MADE_FROM["estimate"],
        meshes=MESH_OPTIONS,
        sims=SIMS,
    shell:
        "exec python -P -m fingerfit estimate {input.settings} --data {input.data} {params.meshes}"
        " --sims {params.sims} --last {input.last} --threads {threads} --out {output.estimate}"
        " --table {output.table} 2> {log}"


rule plot:
    # The figures: deformed mesh, pictures, force against displacement, course of the search.
    input:
        **MESHES,
        rounds=rounds_and_solutions,
        settings=ancient(SETTINGS_FILE),
        data=f"{MODEL}/prepared.npz",
        last=last_round,
    output:
        figures=FIGURES,
    log:
        f"{MODEL}/logs/plot.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        code=CODE["plot"],
        made_from=MADE_FROM["plot"],
        meshes=MESH_OPTIONS,
        sims=SIMS,
        figures=subpath(output[0], parent=True),
    shell:
        "exec python -P -m fingerfit plot {input.settings} --data {input.data} {params.meshes}"
        " --sims {params.sims} --last {input.last} --out {params.figures} 2> {log}"
