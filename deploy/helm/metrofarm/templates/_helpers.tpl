{{- define "metrofarm.name" -}}
{{- .Release.Name | trunc 40 | trimSuffix "-" -}}
{{- end }}

{{/* metrofarm.labels: list of the root and the component */}}
{{- define "metrofarm.labels" -}}
{{- $root := index . 0 -}}
{{ include "metrofarm.selector" . }}
app.kubernetes.io/version: {{ $root.Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ $root.Release.Service }}
helm.sh/chart: {{ printf "%s-%s" $root.Chart.Name $root.Chart.Version }}
{{- end }}

{{- define "metrofarm.selector" -}}
{{- $root := index . 0 -}}
app.kubernetes.io/name: metrofarm
app.kubernetes.io/instance: {{ $root.Release.Name }}
app.kubernetes.io/component: {{ index . 1 }}
{{- end }}

{{- define "metrofarm.image" -}}
{{- $root := index . 0 -}}
{{- with $root.Values.image.registry }}{{ . }}/{{ end }}metrofarm-{{ index . 1 }}:{{ $root.Values.image.tag | default $root.Chart.AppVersion }}
{{- end }}

{{/* Of every pod: nobody special, and none of the cluster's secrets. */}}
{{- define "metrofarm.pod" -}}
automountServiceAccountToken: false
enableServiceLinks: false
serviceAccountName: {{ include "metrofarm.name" . }}
{{- with .Values.image.pullSecrets }}
imagePullSecrets:
  {{- range . }}
  - name: {{ . }}
  {{- end }}
{{- end }}
securityContext:
  runAsNonRoot: true
  runAsUser: 10001
  runAsGroup: 10001
  fsGroup: 10001
  fsGroupChangePolicy: OnRootMismatch
  seccompProfile:
    type: RuntimeDefault
{{- end }}

{{- define "metrofarm.container" -}}
securityContext:
  allowPrivilegeEscalation: false
  readOnlyRootFilesystem: true
  capabilities:
    drop: [ALL]
{{- end }}

{{/* metrofarm.placement: list of the root, the values of the component and its name */}}
{{- define "metrofarm.placement" -}}
{{- $values := index . 1 -}}
{{- with $values.nodeSelector }}
nodeSelector: {{ toYaml . | nindent 2 }}
{{- end }}
{{- with $values.tolerations }}
tolerations: {{ toYaml . | nindent 2 }}
{{- end }}
{{- with $values.affinity }}
affinity: {{ toYaml . | nindent 2 }}
{{- end }}
topologySpreadConstraints:
  - maxSkew: 1
    topologyKey: kubernetes.io/hostname
    whenUnsatisfiable: ScheduleAnyway
    labelSelector:
      matchLabels: {{ include "metrofarm.selector" (list (index . 0) (index . 2)) | nindent 8 }}
{{- end }}

{{/* The coordinators' stable names with the farm port, for workers. */}}
{{- define "metrofarm.coordinators" -}}
{{- $name := include "metrofarm.name" . -}}
{{- $all := list -}}
{{- range $i := until (int .Values.coordinator.replicas) -}}
{{- $all = append $all (printf "%s-coordinator-%d.%s-coordinator.%s.svc:7070" $name $i $name $.Release.Namespace) -}}
{{- end -}}
{{ join "," $all }}
{{- end }}

{{/* metrofarm.mebibytes: of a quantity of memory such as 8Gi, 1.5G, 500M or a number of bytes */}}
{{- define "metrofarm.mebibytes" -}}
{{- $number := regexFind "^[0-9]+([.][0-9]+)?" (toString .) -}}
{{- $unit := trimPrefix $number (toString .) -}}
{{- $bytes := dict "" 1.0 "k" 1e3 "M" 1e6 "G" 1e9 "T" 1e12 "Ki" 1024.0 "Mi" 1048576.0 "Gi" 1073741824.0 "Ti" 1099511627776.0 -}}
{{- if or (not $number) (not (hasKey $bytes $unit)) -}}
{{- fail (printf "%v is no amount of memory; write it as 8Gi or 8192Mi" .) -}}
{{- end -}}
{{- divf (mulf (float64 $number) (get $bytes $unit)) 1048576.0 | floor | int64 -}}
{{- end }}

{{- define "metrofarm.check" -}}
{{- if and (not .Values.redis.enabled) (not .Values.redis.url) (not .Values.redis.urlSecret) -}}
{{- fail "redis.enabled is false: set redis.url or redis.urlSecret" -}}
{{- end -}}
{{- if and (gt (int .Values.coordinator.replicas) 1) (not .Values.blobs.s3.location) (not .Values.blobs.volume.claimName) (ne .Values.blobs.volume.accessMode "ReadWriteMany") -}}
{{- fail "several coordinators share their blobs: set blobs.volume.accessMode to ReadWriteMany, or blobs.s3.location" -}}
{{- end -}}
{{- if lt (int .Values.coordinator.replicas) (int .Values.coordinator.minAvailable) -}}
{{- fail "coordinator.minAvailable is larger than coordinator.replicas" -}}
{{- end -}}
{{- end }}
