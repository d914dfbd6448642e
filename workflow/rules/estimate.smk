rule estimate:
    # The constants with their standard errors, from the last round and the sensitivities it asked for.
    input:
        rounds_and_solutions,
        last=last_round,
        settings=ancient(SETTINGS_FILE),
        data=f"{MODEL}/prepared.npz",
        **MESHES,
    output:
        estimate=f"{MODEL}/estimate.json",
        table=f"{MODEL}/table.txt",
    log:
        f"{MODEL}/logs/estimate.log",
    params:
        settings=PARTS["estimate"],
        code=layout.fingerprint("estimate"),
    threads: 1
    resources:
        mem_mb=1000,
    shell:
        "fingerfit estimate {input.settings} --data {input.data} {MESH_OPTIONS} --sims {STUDY}/sims --last {input.last}"
        " --out {output.estimate} --table {output.table} 2> {log}"


rule plot:
    # The figures: deformed mesh, pictures, force against displacement, course of the search.
    input:
        rounds_and_solutions,
        settings=ancient(SETTINGS_FILE),
        data=f"{MODEL}/prepared.npz",
        **MESHES,
        last=last_round,
    output:
        FIGURES,
    log:
        f"{MODEL}/logs/plot.log",
    params:
        code=layout.fingerprint("plot"),
    threads: 1
    resources:
        mem_mb=1000,
    shell:
        "fingerfit plot {input.settings} --data {input.data} {MESH_OPTIONS} --sims {STUDY}/sims --last {input.last}"
        " --out {MODEL}/figures 2> {log}"
