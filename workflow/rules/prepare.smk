rule prepare:
    # Reads and checks the study, smooths and scales the pictures, makes the mesh.
    input:
        settings=ancient(SETTINGS_FILE),
        study=ancient(STUDY_FILES),
    output:
        **MESHES,
        data=f"{MODEL}/prepared.npz",
    log:
        f"{MODEL}/logs/prepare.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        settings=PARTS["prepare"],
        code=CODE["prepare"],
        made_from=MADE_FROM["prepare"],
        meshes=MESH_OPTIONS,
    shell:
        "exec python -P -m fingerfit prepare {input.settings} --out {output.data} {params.meshes} 2> {log}"
